"""Censored rows as ordinary ones: likelihood, slope and curvature against SciPy and finite differences."""

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.data.transforms import working


def log_probability(u: float, reach: float) -> float:
    """Ln of the probability of the range about u in which a censored value lies."""
    if reach == -np.inf:
        return float(stats.norm.logcdf(u))
    if reach == np.inf:
        return float(stats.norm.logsf(u))
    return float(np.log(stats.norm.cdf(u + reach) - stats.norm.cdf(u - reach)))


@pytest.mark.parametrize("reach", [-np.inf, np.inf, 0.3, 2.0])
@pytest.mark.parametrize("u", [-3.0, -0.4, 0.0, 1.1, 4.0])
def test_a_censored_row_has_the_deviance_slope_and_curvature_of_its_likelihood(u, reach):
    work = working(np.array([u, 0.7]), np.array([reach, 0.0]))
    assert work.deviance == pytest.approx(-2.0 * log_probability(u, reach) + 0.49, rel=1e-9)
    step = 1e-4
    low, here, high = (log_probability(u + k * step, reach) for k in (-1.0, 0.0, 1.0))
    slope, curvature = (high - low) / (2.0 * step), -(high - 2.0 * here + low) / step**2
    assert -work.residual[0] * work.weight[0] == pytest.approx(slope, rel=1e-5, abs=1e-7)
    assert work.weight[0] ** 2 == pytest.approx(curvature, rel=2e-3, abs=1e-5)
    assert (work.residual[1], work.weight[1]) == (0.7, 1.0)


@pytest.mark.parametrize("reach", [-np.inf, np.inf, 1.0])
def test_a_value_far_outside_its_range_stays_finite(reach):
    for u in (-60.0, 60.0):
        work = working(np.array([u]), np.array([reach]))
        assert np.isfinite([work.deviance, work.residual[0], work.weight[0]]).all()
