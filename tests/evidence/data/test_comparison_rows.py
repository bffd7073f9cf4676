"""Censored values on the comparison scale, and what a fit makes of them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, stats

from taichi_erosion.evidence.data.comparison_rows import censored_scale
from taichi_erosion.evidence.data.problem import Observable
from taichi_erosion.evidence.data.transforms import working
from taichi_erosion.evidence.race.posterior import raced
from taichi_erosion.evidence.race.summary import summary
from tests.evidence.linear_study import LEVEL_SD, linear_problem


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


def test_an_interval_on_a_logarithmic_scale_keeps_its_ends():
    log = Observable("y", "log")
    value, reach = np.array([22.5, 5.0, 12.0]), np.array([2.5, 6.0, np.inf])
    z, span = censored_scale(log, value, reach)
    assert np.exp([z[0] - span[0], z[0] + span[0]]) == pytest.approx([20.0, 25.0])
    assert (np.exp(z[1]), span[1]) == (pytest.approx(11.0), -np.inf)  # from -1 to 11: only the upper end
    assert (np.exp(z[2]), span[2]) == (pytest.approx(12.0), np.inf)


def test_a_fit_to_limits_and_intervals_is_that_of_their_likelihood():
    problem = linear_problem({}, {}, sd=0.2, count=6)
    limit = np.array([0.4, -0.3, 0.2, np.nan, np.nan, np.nan])
    reach = np.array([np.inf, -np.inf, 0.15, 0.0, 0.0, 0.0])
    table = replace(problem.measurements, censored=np.isfinite(limit), limit=limit, reach=reach)
    found = raced(replace(problem, measurements=table), 1)
    assert np.isinf(found.race.prepared.rows.reach).sum() == 2

    ends = [(0.4, np.inf), (-np.inf, -0.3), (0.05, 0.35)]

    def deviance(level: float) -> float:
        total = -2.0 * stats.norm.logpdf(level, 0.0, LEVEL_SD)
        total -= 2.0 * stats.norm.logpdf(problem.measurements.value[3:], level, 0.2).sum()
        spans = [stats.norm.cdf(high, level, 0.2) - stats.norm.cdf(low, level, 0.2) for low, high in ends]
        return float(total - 2.0 * np.log(spans).sum())

    wanted = optimize.minimize_scalar(deviance, (0.0, 0.3)).x
    # the race has a scatter and a level beside it, each near nothing
    assert summary(found).numbers["level"].now.value == pytest.approx(wanted, abs=0.03)
