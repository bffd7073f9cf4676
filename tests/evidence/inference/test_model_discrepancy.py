"""The smooth rival against an independent computation of its evidence."""

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.inference.model_discrepancy import (
    AMPLITUDES,
    LENGTHS,
    condition_axes,
    discrepancy_gain,
    kernels,
)
from tests.evidence.linear_study import linear_problem, screened


@pytest.mark.parametrize("truth", [{}, {"bend": 1.0}])
def test_the_gain_is_the_ratio_of_two_multivariate_normal_densities(truth):
    problem = linear_problem({"bend": lambda x: x**2}, truth, count=15, calibrated=False)
    prepared, found = screened(problem)
    family = kernels(prepared)
    assert family.count == len(LENGTHS), "one condition"
    residual = problem.measurements.value / prepared.sd
    factors = prepared.doubt.factor
    expected = np.empty((family.count * len(AMPLITUDES), factors.size))
    (axis,) = condition_axes(prepared).values()
    for row, (length, size) in enumerate((k, a) for k in LENGTHS for a in AMPLITUDES):
        smooth = size**2 * np.exp(-0.5 * ((axis[:, np.newaxis] - axis) / length) ** 2)
        for column, factor in enumerate(factors):
            whole = factor**2 * (np.eye(15) + smooth)  # discrepancy in units of the noise
            with_it = stats.multivariate_normal(cov=whole).logpdf(residual)
            without = stats.multivariate_normal(cov=factor**2 * np.eye(15)).logpdf(residual)
            expected[row, column] = with_it - without
    exact = log_sum_exp(expected, axis=0) - np.log(expected.shape[0])
    assert discrepancy_gain(prepared, found.base, family) == pytest.approx(exact, rel=1e-6, abs=1e-6)


def test_a_discrepancy_gains_only_where_the_residual_is_smooth():
    shapes = {"bend": lambda x: x**2}
    smooth, null = (screened(linear_problem(shapes, truth)) for truth in ({"bend": 1.0}, {}))
    assert np.min(discrepancy_gain(smooth[0], smooth[1].base, kernels(smooth[0]))) > 1.0
    assert np.max(discrepancy_gain(null[0], null[1].base, kernels(null[0]))) < 0.5
