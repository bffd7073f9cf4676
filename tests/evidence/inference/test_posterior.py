"""Posterior probabilities and credible intervals against closed forms."""

from math import comb

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.data.findings import NONE, OUTSIDE
from taichi_erosion.evidence.inference.map_fit import fit, fit_base
from taichi_erosion.evidence.inference.marginal_likelihood import expand, score
from taichi_erosion.evidence.inference.posterior import (
    Hypothesis,
    log_prior_of,
    posterior_of,
    quantile,
    strength_estimates,
    upper_strength,
)
from taichi_erosion.evidence.models.prepared_problem import prepare
from taichi_erosion.evidence.inference.verdict_levels import (
    MOST_EFFECTS,
    PRIOR_NONE,
    PRIOR_OUTSIDE,
    PRIOR_REMAINDER,
    PRIOR_SETS,
)
from tests.evidence.linear_study import linear_problem

SHAPES = {"slope": lambda x: x, "bend": lambda x: x**2}


@pytest.mark.parametrize("count", [1, 2, 7])
def test_priors_of_all_explanations_sum_to_one(count):
    single = sum(np.exp(log_prior_of(("a",), outside, count)) for outside in (False, True))
    total = count * single + sum(np.exp(log_prior_of((), outside, count)) for outside in (False, True))
    for size in range(2, min(count, MOST_EFFECTS) + 1):
        total += comb(count, size) * np.exp(log_prior_of(tuple("abcd"[:size]), False, count))
    assert total == pytest.approx(1.0)
    assert np.exp(log_prior_of((), False, count)) == pytest.approx(PRIOR_NONE)
    assert np.exp(log_prior_of(("a",), True, count)) == pytest.approx(PRIOR_REMAINDER * single)


def test_probabilities_are_priors_times_evidence_and_rejected_names_count_outside():
    prepared = prepare(problem := linear_problem(SHAPES, {}), problem.measurements, 1)
    weights = {(): 3.0, ("slope",): 5.0, ("bend",): 2.0, ("slope", "bend"): 4.0}
    flat = np.zeros(prepared.doubt.factor.size)
    listed = [
        Hypothesis(names, False, float(np.log(w)), flat + 1.5, rejected=names == ("bend",))
        for names, w in weights.items()
    ]
    found = posterior_of(prepared, [*listed, Hypothesis((), True, np.log(6.0), flat + 1.5, rejected=True)])
    assert found.probability[NONE] == pytest.approx(3.0 / 20.0)
    assert found.probability[OUTSIDE] == pytest.approx(8.0 / 20.0)
    assert found.probability["slope+bend"] == pytest.approx(4.0 / 20.0)
    assert found.inclusion == pytest.approx({"slope": 9.0 / 20.0, "bend": 4.0 / 20.0})
    assert found.named == pytest.approx(9.0 / 20.0)
    assert sum(found.probability.values()) == pytest.approx(1.0)
    assert found.log_bayes == pytest.approx({"slope": 0.0, "bend": 0.0}), "evidence alone, no prior"
    assert PRIOR_NONE + PRIOR_OUTSIDE + sum(PRIOR_SETS) < 1.0


def test_a_quantile_is_linear_within_cells_and_the_upper_bound_is_that_of_a_half_normal():
    grid = np.linspace(0.0, 2.0, 201)
    assert quantile(grid, np.ones(201), 0.25) == pytest.approx(0.5, abs=0.01)
    dense = np.linspace(0.0, 8.0, 4001)
    assert upper_strength(dense, -0.5 * dense**2) == pytest.approx(stats.norm.ppf(0.975), abs=2e-3)


def test_the_interval_of_a_strong_effect_is_that_of_least_squares():
    prepared, _, _ = fit_base(prepare(p := linear_problem(SHAPES, {"slope": 1.0}), p.measurements, 1))
    scored = score(prepared, expand(prepared, fit(prepared, ("slope",), [np.array([0.0, 0.9])])))
    shape = p.measurements.conditions["x"] / prepared.sd
    sd = 1.0 / np.sqrt(shape @ shape)  # orthogonal to the level, prior of the strength negligible
    # averaged over the factor by which an unchecked sd may be too small: between 1 and 1.6 times as wide
    (estimate,) = strength_estimates(prepared, scored).values()
    width = estimate.high - estimate.low
    assert 1.0 < width / (2.0 * stats.norm.ppf(0.95) * sd) < 1.6
    assert estimate.low < 1.0 < estimate.high
    assert not estimate.at_bound
