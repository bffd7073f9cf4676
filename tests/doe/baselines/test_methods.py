"""Baselines on a linear study whose answers are known."""

import numpy as np
import pytest

from doe.baselines.methods import posterior_with, told_by_all
from tests.evidence.linear_study import linear_problem

SHAPES = {"slope": lambda x: x, "bend": lambda x: x**2, "cube": lambda x: x**3}


def test_a_strong_effect_is_told_by_all_and_named_by_two():
    told = told_by_all(linear_problem(SHAPES, {"bend": 1.0}, sd=0.05), 1)
    assert told["correlation"].named == told["BIC"].named == "bend"
    assert told["discrepancy"].flagged


def test_where_nothing_is_missing_two_of_them_are_silent():
    told = told_by_all(linear_problem(SHAPES, {}, sd=0.1, seed=2), 1)
    assert not told["BIC"].flagged
    assert not told["discrepancy"].flagged


def test_the_posterior_beside_a_discrepancy_is_that_of_the_joint_normal():
    generator = np.random.default_rng(1)
    slopes, residual = generator.standard_normal((6, 2)), generator.standard_normal(6)
    factor = generator.standard_normal((6, 6))
    kernel = factor @ factor.T
    found = posterior_with(residual, slopes, kernel)
    precision = slopes.T @ np.linalg.inv(np.eye(6) + kernel) @ slopes + np.eye(2)
    assert found.covariance == pytest.approx(np.linalg.inv(precision))
    exact = np.linalg.solve(precision, slopes.T @ np.linalg.solve(np.eye(6) + kernel, residual))
    assert found.position == pytest.approx(exact)
    whole = np.eye(6) + kernel + slopes @ slopes.T
    log_density = -0.5 * residual @ np.linalg.inv(whole) @ residual - 0.5 * np.log(np.linalg.det(whole))
    assert found.log_evidence == pytest.approx(log_density)
