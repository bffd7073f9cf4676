"""The fit of one hypothesis against ridge regression, and shared errors against their full covariance."""

import numpy as np
import pytest

from taichi_erosion.evidence.inference.map_fit import deviance, fit
from taichi_erosion.evidence.models.prepared_problem import prepare
from tests.evidence.linear_study import LEVEL_SD, linear_problem

SHAPES = {"slope": lambda x: x, "bend": lambda x: x**2}


def test_a_fit_is_the_ridge_regression_of_a_linear_model():
    problem = linear_problem(SHAPES, {"slope": 1.0})
    prepared = prepare(problem, problem.measurements, 1)
    best = fit(prepared, ("slope",), [np.zeros(2)])
    white = np.column_stack([LEVEL_SD * np.ones(24), problem.measurements.conditions["x"]]) / 0.1
    prior = np.diag([1.0, 1.5**-2])  # of the level in sd, of the strength
    right = white.T @ (problem.measurements.value / 0.1)
    exact = np.linalg.solve(white.T @ white + prior, right)
    # steps end where the misfit falls by less than 0.02, that is 0.1 sd
    sd = np.sqrt(np.diag(np.linalg.inv(white.T @ white + prior)))
    assert np.all(np.abs(np.append(best.x, best.psi) - exact) < 0.15 * sd)


def test_a_strength_stops_at_zero_where_the_data_ask_for_a_negative_one():
    problem = linear_problem(SHAPES, {"slope": -1.0})
    prepared = prepare(problem, problem.measurements, 1)
    assert fit(prepared, ("slope",), [np.array([0.0, 1.0])]).psi[0] == 0.0


def test_shared_errors_at_their_best_are_those_of_the_full_covariance():
    random = np.random.default_rng(2)
    residual, shared = random.standard_normal(7), random.standard_normal((7, 2))
    exact = residual @ np.linalg.solve(np.eye(7) + shared @ shared.T, residual)
    assert deviance(residual, shared, np.zeros(7, dtype=bool)) == pytest.approx(exact)
