"""Sets of free levels against normal densities."""

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.inference.marginal_likelihood import level_sets, log_level_sets


def test_the_evidence_of_sets_of_levels_is_that_of_normals():
    """Two levels measured with correlated errors: every set in turn against its normal density."""
    precision, measured = np.array([[9.0, 2.0], [2.0, 4.0]]), np.array([0.8, -0.3])
    noise = np.linalg.inv(precision)
    covariance = np.linalg.inv(precision + np.eye(2))  # prior sd 1
    best = covariance @ precision @ measured
    sets, log_prior = level_sets(2)
    found = log_level_sets(best[:, np.newaxis], covariance)[:, 0] - log_prior
    whole = stats.multivariate_normal(cov=noise + np.eye(2)).logpdf(measured)
    for chosen, value in zip(sets, found, strict=True):
        free = np.diag([1.0 if k in chosen else 0.0 for k in range(2)])
        exact = stats.multivariate_normal(cov=noise + free).logpdf(measured) - whole
        assert value == pytest.approx(exact, abs=1e-9)
    assert np.exp(log_prior).sum() == pytest.approx(1.0)
