"""Rows of one heap: marginal likelihoods against dense normal densities, and nothing new for lone heaps."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.inference.map_fit import fit_base
from taichi_erosion.evidence.inference.marginal_likelihood import expand, score
from taichi_erosion.evidence.models.prepared_problem import PreparedProblem
from tests.evidence.one_heap_study import calibrated, heaps


def dense_covariance(prepared: PreparedProblem, factor: float, jacobian: np.ndarray) -> np.ndarray:
    """f^2 V of the scatter, whole, with the prior of the slope and the shared errors as covariances."""
    rows = prepared.rows
    scatter = np.diag(prepared.variance) + rows.covariance
    return factor**2 * scatter + rows.shared @ rows.shared.T + jacobian @ jacobian.T


@pytest.mark.parametrize("levels", [False, True])
def test_the_marginal_likelihood_is_that_of_the_dense_normal_density(levels):
    prepared = calibrated(heaps(0))
    if levels:
        prepared = prepared.with_free_levels({"angle": 0.3, "width": 0.6})
    prepared, best, _ = fit_base(prepared, weighted=True)
    expansion = expand(prepared, best)
    if levels:
        prepared = replace(prepared, levels=())  # all of them free: no average over sets of levels
    found = score(prepared, expansion).log_evidence
    at_prior = expansion.mean - expansion.jacobian @ best.x
    gap, n = prepared.rows.z - at_prior, prepared.rows.size
    wanted = [
        stats.multivariate_normal(cov=dense_covariance(prepared, float(f), expansion.jacobian)).logpdf(gap)
        + 0.5 * n * np.log(2.0 * np.pi)
        for f in prepared.doubt.factor
    ]
    # the slope enters by its logarithm: the model is linear only about the best fit, to 1e-3 of its sd
    np.testing.assert_allclose(found, wanted, atol=2e-3)


def test_heaps_of_one_row_each_change_no_bit():
    problem = heaps(3, named=False)
    lone = tuple(f"lone {k}" for k in range(problem.measurements.size))
    other = replace(problem, measurements=replace(problem.measurements, heap=lone))
    found = []
    for each in (problem, other):
        prepared = calibrated(each)
        assert prepared.heaps is None
        assert prepared.white.root is None
        prepared, best, _ = fit_base(prepared, weighted=True)
        found.append(score(prepared, expand(prepared, best)).log_evidence)
    np.testing.assert_array_equal(found[0], found[1])
