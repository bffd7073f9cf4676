"""Signatures by projection in plane geometry, and their Bayes factor by quadrature."""

import numpy as np
import pytest
from scipy import integrate, stats

from tests.evidence.linear_study import linear_problem, screened

SHAPES = {"slope": lambda x: x, "lift": lambda x: 1.0 + 0.5 * x, "none": lambda x: 0.0 * x}
X = np.linspace(-1.0, 1.0, 24)
EXPECTED = 1.5  # strength at which norms are stated: the scale of the prior


@pytest.fixture(scope="module")
def study():
    return screened(linear_problem(SHAPES, {"slope": 0.05}))


def test_the_norm_is_what_the_level_cannot_imitate(study):
    _, found = study
    slope, lift = found.signature("slope"), found.signature("lift")
    assert slope.norm == pytest.approx(EXPECTED * np.linalg.norm(X) / 0.1, rel=0.03)  # nearest grid strength
    assert lift.norm == pytest.approx(0.5 * slope.norm, rel=0.01)
    share = 0.5 * np.linalg.norm(X) / np.linalg.norm(1.0 + 0.5 * X)
    assert lift.absorption == pytest.approx(1.0 - share, abs=1e-3)


def test_an_effect_without_a_signature_is_not_resolved(study):
    _, found = study
    assert not found.signature("none").resolved
    assert found.signature("slope").resolved


def test_a_bayes_factor_is_the_likelihood_averaged_over_the_half_normal_prior(study):
    _, found = study
    slope = found.signature("slope")
    per_unit = slope.free[-1] / slope.grid[-1]
    along, energy = float(per_unit @ found.residual), float(per_unit @ per_unit)
    prior = stats.truncnorm(0.0, 2.0, scale=EXPECTED)  # up to strength 3

    def integrand(strength: float) -> float:
        return np.exp(strength * along - 0.5 * strength**2 * energy) * prior.pdf(strength)

    exact = np.log(integrate.quad(integrand, 0.0, 0.5, points=[0.05])[0])  # likelihood is gone beyond
    assert float(slope.log_bayes(found.residual)) == pytest.approx(exact, abs=0.1)
    assert slope.likely_strength(found.residual) == pytest.approx(along / energy, abs=0.02)
