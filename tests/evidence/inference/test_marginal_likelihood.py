"""The marginal likelihood against multivariate normal densities, which a linear model has."""

import numpy as np
import pytest
from scipy import integrate, stats

from taichi_erosion.evidence.inference.map_fit import fit
from taichi_erosion.evidence.inference.marginal_likelihood import cell_width, expand, log_prior, score
from taichi_erosion.evidence.models.prepared_problem import prepare
from tests.evidence.linear_study import LEVEL_SD, linear_problem

SHAPES = {"slope": lambda x: x}
CONSTANT = 0.5 * 24 * np.log(2.0 * np.pi)  # left out of every evidence alike


def test_the_evidence_of_the_bare_model_is_that_of_a_correlated_normal():
    problem = linear_problem(SHAPES, {}, sd=0.5)
    prepared = prepare(problem, problem.measurements, 1)
    found = score(prepared, expand(prepared, fit(prepared, (), [np.zeros(1)])))
    for factor, value in zip(prepared.doubt.factor, found.log_evidence, strict=True):
        covariance = (0.5 * factor) ** 2 * np.eye(24) + LEVEL_SD**2  # all rows share the level
        exact = stats.multivariate_normal(cov=covariance).logpdf(problem.measurements.value) + CONSTANT
        assert value == pytest.approx(exact, abs=0.05), "the fit ends within 0.02 of the least misfit"


def test_the_evidence_of_an_effect_is_the_integral_over_its_half_normal_prior():
    problem = linear_problem(SHAPES, {"slope": 0.8}, sd=0.5)
    prepared = prepare(problem, problem.measurements, 1)
    found = score(prepared, expand(prepared, fit(prepared, ("slope",), [np.array([0.0, 0.8])])))
    x, z = problem.measurements.conditions["x"], problem.measurements.value
    normal = stats.multivariate_normal(cov=0.25 * np.eye(24) + LEVEL_SD**2)
    weight = 2.0 * stats.norm(scale=1.5).cdf(3.0) - 1.0  # of the prior within [0, 3]

    def integrand(strength: float) -> float:
        return np.exp(normal.logpdf(z - strength * x)) * 2.0 * stats.norm(scale=1.5).pdf(strength) / weight

    exact = np.log(integrate.quad(integrand, 0.0, 3.0)[0]) + CONSTANT
    assert prepared.doubt.factor[0] == 1.0
    # the grid's trapezoids are a fifth of an sd wide, and no expansion may undercut its fit by more than 0.5
    assert found.log_evidence[0] == pytest.approx(exact, abs=0.1)


def test_weights_of_a_grid_are_a_density_times_its_trapezoids():
    grid = np.linspace(0.0, 3.0, 31)
    assert cell_width(grid).sum() == pytest.approx(3.0)
    assert np.exp(log_prior(grid, 1.5, 3.0)).sum() == pytest.approx(1.0, abs=1e-3)
    half = np.exp(log_prior(grid[:16], 1.5, 3.0)).sum()
    weight = stats.norm(scale=1.5)
    exact = (weight.cdf(1.5) - 0.5) / (weight.cdf(3.0) - 0.5)
    assert half == pytest.approx(exact, abs=1e-3), "a grid over a part of the range holds that part's share"
    assert cell_width(np.array([1.0])) == pytest.approx([1.0])
