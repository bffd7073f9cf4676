"""Censored values on the comparison scale, and what a fit makes of them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, stats

from taichi_erosion.evidence.data.comparison_rows import censored_scale
from taichi_erosion.evidence.data.problem import Observable
from taichi_erosion.evidence.race.posterior import raced
from taichi_erosion.evidence.race.summary import summary
from tests.evidence.linear_study import LEVEL_SD, linear_problem


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
