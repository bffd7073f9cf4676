"""Quantiles of mixtures against closed forms and independent integrations."""

import numpy as np
import pytest
from scipy import integrate, stats

from taichi_erosion.evidence.inference.intervals.mixtures import Mixture, joined, tabulated


def one(weight: float, mean: float, sd: float, low: float = -np.inf, high: float = np.inf) -> Mixture:
    """A mixture of a single normal distribution."""
    return Mixture(np.array([weight]), np.array([mean]), np.array([sd]), low, high)


def test_the_quantile_of_one_normal_distribution_does_not_depend_on_its_weight():
    for level in (0.05, 0.5, 0.95):
        exact = stats.norm(2.0, 3.0).ppf(level)
        assert one(0.3, 2.0, 3.0).quantile(level) == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize("mean", [-20.0, -1.0, 0.5, 30.0])
def test_a_normal_distribution_is_cut_at_its_range(mean):
    cut = one(1.0, mean, 1.0, 0.0, 2.0)
    for level in (0.05, 0.5, 0.95):
        found = cut.quantile(level)
        if abs(mean) < 5.0:
            assert found == pytest.approx(stats.truncnorm(-mean, 2.0 - mean, loc=mean).ppf(level), abs=1e-6)
        else:  # held at 5 sd: next to the end of the range
            assert min(found, 2.0 - found) < 0.6


def test_a_mixture_with_a_table_agrees_with_integration():
    grid = np.linspace(0.0, 6.0, 61)
    density = grid * np.exp(-grid)
    widths = np.gradient(grid)
    widths[[0, -1]] *= 0.5
    share = 0.4 * density * widths / np.sum(density * widths)
    whole = joined([one(0.6, 3.0, 0.5), tabulated(grid, share)], 0.0, 6.0)
    norm = integrate.quad(lambda t: t * np.exp(-t), 0.0, 6.0)[0]

    def below(point: float) -> float:
        own = integrate.quad(lambda t: t * np.exp(-t), 0.0, point)[0] / norm
        return 0.6 * stats.norm(3.0, 0.5).cdf(point) + 0.4 * own

    for level in (0.05, 0.3, 0.95):
        assert below(whole.quantile(level)) == pytest.approx(level, abs=2e-3)
