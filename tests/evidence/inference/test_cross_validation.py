"""Cross-validation against refits without each group, which a linear model allows in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.inference.cross_validation import fold_numbers, fold_scores, log_score_gain
from taichi_erosion.evidence.inference.map_fit import fit
from taichi_erosion.evidence.inference.marginal_likelihood import expand
from tests.evidence.linear_study import LEVEL_SD, linear_problem, screened

SHAPES = {"slope": lambda x: x, "bend": lambda x: x**2}


def test_a_fold_is_predicted_from_the_others_alone():
    problem = linear_problem(SHAPES, {})
    prepared, found = screened(problem)
    folds = fold_numbers(prepared)
    assert np.unique(folds).size == 12
    design, white = np.ones((24, 1)) / prepared.sd[:, np.newaxis], problem.measurements.value / prepared.sd
    exact = []
    for fold in range(12):
        out = folds == fold
        covariance = np.linalg.inv(design[~out].T @ design[~out] + LEVEL_SD**-2)
        mean = covariance @ design[~out].T @ white[~out]
        predicted = design[out] @ covariance @ design[out].T + np.eye(2)
        exact.append(stats.multivariate_normal(design[out] @ mean, predicted).logpdf(white[out]))
    scores = fold_scores(prepared, found.base, folds) - np.log(2.0 * np.pi)  # the constant of two rows
    assert scores == pytest.approx(exact, abs=1e-6)


def test_the_true_effect_gains_and_a_wrong_one_does_not():
    prepared, found = screened(linear_problem(SHAPES, {"slope": 1.0}))
    gains = {}
    for name in SHAPES:
        best = fit(prepared, (name,), [np.array([0.0, 1.0])])
        gains[name] = log_score_gain(prepared, found.base, expand(prepared, best))
    assert gains["slope"].gain > 3.0 * gains["slope"].error > 0.0
    assert gains["bend"].gain < 1.0


def test_one_fold_says_nothing():
    prepared, found = screened(linear_problem(SHAPES, {}, count=2))
    same = np.zeros(prepared.rows.size)
    rows = replace(prepared.rows, conditions={"x": same}, group=("g",) * prepared.rows.size)
    assert np.isnan(log_score_gain(replace(prepared, rows=rows), found.base, found.base).gain)
