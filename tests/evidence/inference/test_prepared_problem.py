"""Rows of one heap: marginal likelihoods against dense normal densities, and nothing new for lone heaps."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.inference.map_fit import fit_base
from taichi_erosion.evidence.inference.marginal_likelihood import expand, projected_residual, score
from taichi_erosion.evidence.inference.model_discrepancy import AMPLITUDES, discrepancy_gain, kernels
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.robustness.linear_steps import linear_evidence
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


def test_the_linear_estimate_at_the_stated_noise_is_the_same_density():
    prepared = calibrated(heaps(1))
    prepared = replace(prepared, doubt=replace(prepared.doubt, factor=np.ones(1), log_weight=np.zeros(1)))
    prepared, best, _ = fit_base(prepared, weighted=True)
    expansion = expand(prepared, best)
    gap = prepared.rows.z - expansion.mean + expansion.jacobian @ best.x
    covariance = dense_covariance(prepared, 1.0, expansion.jacobian)
    wanted = stats.multivariate_normal(cov=covariance).logpdf(gap) + 0.5 * gap.size * np.log(2.0 * np.pi)
    assert linear_evidence(prepared, expansion) == pytest.approx(wanted, abs=2e-3)


def test_a_discrepancy_gains_what_the_dense_densities_say():
    prepared = calibrated(heaps(2, strength=0.3))
    prepared, best, _ = fit_base(prepared, weighted=True)
    expansion, family = expand(prepared, best), kernels(prepared)
    left = projected_residual(prepared, expansion)
    assert float(left.stacked @ left.stacked) > 0.0
    gain = discrepancy_gain(prepared, expansion, family)
    gap = prepared.rows.z - expansion.mean + expansion.jacobian @ best.x
    back = np.linalg.inv(prepared.white(np.eye(prepared.rows.size)))
    for k, factor in enumerate(prepared.doubt.factor[:3]):
        # calibrated numbers and shared errors have the prior of the linear rows: theirs over f
        base = prepared.variance * np.eye(gap.size) + prepared.rows.covariance
        others = prepared.rows.shared @ prepared.rows.shared.T + expansion.jacobian @ expansion.jacobian.T
        logs = []
        for vectors, values in zip(family.vectors, family.values, strict=True):
            smooth = back @ (vectors * values) @ vectors.T @ back.T
            for amplitude in AMPLITUDES:
                whole = stats.multivariate_normal(cov=factor**2 * (base + amplitude**2 * smooth + others))
                logs.append(whole.logpdf(gap))
        bare = stats.multivariate_normal(cov=factor**2 * (base + others)).logpdf(gap)
        wanted = np.logaddexp.reduce(logs) - np.log(len(logs)) - bare
        assert gain[k] == pytest.approx(wanted, abs=5e-3)


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


def test_whitened_rows_add_up_to_the_misfit_of_the_joint_scatter():
    prepared = calibrated(heaps(4))
    gap = np.random.default_rng(0).standard_normal(prepared.rows.size)
    white = prepared.white(gap)
    covariance = np.diag(prepared.variance) + prepared.rows.covariance
    assert float(white @ white) == pytest.approx(float(gap @ np.linalg.solve(covariance, gap)), rel=1e-10)
    np.testing.assert_allclose(prepared.white.back(white), gap, rtol=1e-9, atol=1e-12)
    assert prepared.log_correlation == pytest.approx(
        0.5 * np.linalg.slogdet(covariance)[1] - np.sum(np.log(prepared.sd)), rel=1e-9
    )
