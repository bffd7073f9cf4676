"""Mixtures of distributions of one number: normal ones cut at its range, and densities on a grid."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy import optimize, special
from scipy.interpolate import PchipInterpolator

from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.inference.marginal_likelihood import cell_width

FINE = 12  # parts of a cell in which a density is integrated
LEAST_DENSITY = 1e-30  # over its maximum
BEYOND = 5.0  # sd beyond its range at which a normal distribution is held, so that its tail can be computed
CLOSE = 1e-9  # of the whole range, to which a quantile is found


@dataclass(frozen=True)
class Tabulated:
    """A distribution as a table of what lies below some points."""

    points: Floats
    below: Floats  # from 0 to the weight of the distribution


def tabulated(grid: Floats, share: Floats) -> Tabulated:
    """Cell probabilities on a grid; between nodes ln density is a monotone cubic.

    Straight lines between nodes would raise the tails of a narrow density, and with them every interval.
    """
    if grid.size < 2:
        return Tabulated(np.repeat(grid, 2), np.array([0.0, float(np.sum(share))]))
    density = share / cell_width(grid)
    fine = np.unique(np.concatenate([np.linspace(a, b, FINE + 1) for a, b in pairwise(grid)]))
    logs = np.log(np.maximum(density, LEAST_DENSITY * density.max()))
    between = np.exp(PchipInterpolator(grid, logs)(fine) - logs.max())
    pieces = 0.5 * (between[1:] + between[:-1]) * np.diff(fine)
    below = np.concatenate([[0.0], np.cumsum(pieces)])
    return Tabulated(fine, below * (np.sum(share) / below[-1]))


@dataclass(frozen=True)
class Mixture:
    """Normal distributions with weights (k,), each cut at the same range, and tabulated ones."""

    weight: Floats
    mean: Floats
    sd: Floats
    low: float
    high: float
    tables: tuple[Tabulated, ...] = ()

    @cached_property
    def held(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Means not too far beyond the range, sd, share below the range, and weight over that inside."""
        sd = np.maximum(self.sd, 1e-300)
        mean = np.clip(self.mean, self.low - BEYOND * sd, self.high + BEYOND * sd)
        first, last = (special.ndtr((end - mean) / sd) for end in (self.low, self.high))
        return mean, sd, first, self.weight / np.maximum(last - first, 1e-300)

    @cached_property
    def total(self) -> float:
        """Weight of everything."""
        return float(self.weight.sum()) + sum(float(each.below[-1]) for each in self.tables)

    def below(self, point: float) -> float:
        """Weight below a point within the range."""
        mean, sd, first, weight = self.held
        normal = float(weight @ np.maximum(special.ndtr((point - mean) / sd) - first, 0.0))
        return normal + sum(float(np.interp(point, each.points, each.below)) for each in self.tables)

    def quantile(self, level: float) -> float:
        """Point below which a share of the mixture lies."""
        edges = [each.points[k] for each in self.tables for k in (0, -1)]
        reach = (10.0 + BEYOND) * self.sd
        own = np.clip(np.concatenate([self.mean - reach, self.mean + reach, edges]), self.low, self.high)
        low, high, wanted = float(own.min()), float(own.max()), level * self.total
        if self.below(low) >= wanted or self.below(high) <= wanted:
            return low if self.below(low) >= wanted else high
        close, bracket = CLOSE * (high - low), (low, high)
        found = optimize.root_scalar(lambda point: self.below(point) - wanted, bracket=bracket, xtol=close)
        return float(found.root)


def joined(parts: Sequence[Mixture | Tabulated], low: float, high: float) -> Mixture:
    """One mixture of several."""
    normal = [each for each in parts if isinstance(each, Mixture)]
    columns = [[each.weight, each.mean, each.sd] for each in normal]
    weight, mean, sd = (
        (np.concatenate([np.zeros(0), *own]) for own in zip(*columns, strict=True))
        if normal
        else (np.zeros(0),) * 3
    )
    tables = tuple(each for each in parts if isinstance(each, Tabulated))
    return Mixture(weight, mean, sd, low, high, tables)
