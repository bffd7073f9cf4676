"""Which law of drag the measures speak for, and whether the default changes: the rule of README.md."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

import numpy as np

from doe.drag_law.claims import ALONE, HINDERED
from doe.drag_law.measures import NORMAL, Measure
from taichi_erosion.core.setup import Floats
from taichi_erosion.measures.threshold import CONFIDENCE

DRAWS, SEEDS = 1000, {ALONE: 1, HINDERED: 2}
AHEAD = 2  # measures that must speak more for the law of grains among others than against it
NEITHER = "neither"
BINDING = 5  # measures, the first, of which no row may be missing


@dataclass(frozen=True)
class Judged:
    """A measure under both laws; every dictionary is by law."""

    measure: Measure
    own: dict[str, Floats]  # misfit of every row, NaN where it is missing
    misfits: dict[str, Floats]  # the same, NaN too in rows that are missing under the other law
    errors: dict[str, Floats]  # of the misfits
    figure: dict[str, float]  # root of the mean square misfit
    intervals: dict[str, tuple[float, float]]  # of the figures
    difference: tuple[float, float, float]  # of the figures, hindered less alone: value, low, high

    @property
    def complete(self) -> bool:
        """Whether both laws have every row."""
        return all(np.isfinite(numbers.logs).all() for numbers in self.measure.simulated.values())

    @property
    def known(self) -> int:
        """Rows that both laws have."""
        return int(np.isfinite(self.misfits[ALONE]).sum())

    @property
    def speaks_for(self) -> str:
        """Law with the smaller figure where the interval of the difference tells; else nothing."""
        _, low, high = self.difference
        return HINDERED if high < 0.0 else ALONE if low > 0.0 else ""

    def within(self, law: str) -> int:
        """Rows that have what is asked for; without a band, those whose interval holds what is wanted."""
        if self.measure.band is None:
            return int(np.sum(np.abs(self.misfits[law]) <= NORMAL * self.errors[law]))
        low, high = np.log(self.measure.band)
        return int(np.sum((self.misfits[law] >= low) & (self.misfits[law] <= high)))

    def fails(self, law: str) -> bool:
        """Whether an interval lies wholly outside of what is asked for."""
        if self.measure.largest is not None:
            return self.intervals[law][0] > self.measure.largest
        low, high = np.log(self.measure.band or (1.0, 1.0))
        reach = NORMAL * self.errors[law]
        return bool(np.any((self.misfits[law] + reach < low) | (self.misfits[law] - reach > high)))


def judged(measure: Measure) -> Judged:
    """Misfits and figures of both laws, and the difference of the figures."""
    own = {law: measure.misfits(numbers.logs) for law, numbers in measure.simulated.items()}
    kept = np.isfinite([*own.values()]).all(axis=0)
    misfits = {law: np.where(kept, found, nan) for law, found in own.items()}
    drawn = {law: draws(measure, law) for law in misfits}
    figures = {law: root_mean_square(np.where(kept, found, nan)) for law, found in drawn.items()}
    figure = {law: float(root_mean_square(found)) for law, found in misfits.items()}
    return Judged(
        measure,
        own,
        misfits,
        {law: found.std(axis=0) for law, found in drawn.items()},
        figure,
        {law: above_none(interval(figure[law], figures[law])) for law in misfits},
        with_interval(figure[HINDERED] - figure[ALONE], figures[HINDERED] - figures[ALONE]),
    )


def root_mean_square(misfits: Floats) -> Floats:
    """Root of the mean square over the last axis, of rows that are known; NaN without one."""
    known = np.isfinite(misfits)
    count = known.sum(axis=-1)
    total = np.square(np.where(known, misfits, 0.0)).sum(axis=-1)
    return np.sqrt(np.divide(total, count, out=np.full(np.shape(count), nan), where=count > 0))


def draws(measure: Measure, law: str) -> Floats:
    """Misfits [draw, row] of simulated numbers with errors drawn anew."""
    numbers = measure.simulated[law]
    noise = np.random.default_rng(SEEDS[law]).standard_normal((DRAWS, numbers.logs.size))
    return np.array([measure.misfits(numbers.logs + each * numbers.errors) for each in noise])


def interval(found: float, drawn: Floats) -> tuple[float, float]:
    """95 % interval of a figure.

    Drawn errors add to those that the numbers have already and make a root of a mean square larger, so the
    mean of the draws is moved to what was found.
    """
    tails = 0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE
    low, high = np.quantile(drawn - drawn.mean(), tails)
    return found + float(low), found + float(high)


def above_none(ends: tuple[float, float]) -> tuple[float, float]:
    """Interval of a root of a mean square, which is not negative."""
    return max(ends[0], 0.0), ends[1]


def with_interval(found: float, drawn: Floats) -> tuple[float, float, float]:
    """A figure and its interval."""
    return found, *interval(found, drawn)


def becomes_default(found: Sequence[Judged]) -> tuple[bool, str]:
    """Whether the law of grains among others becomes the default, and why, as one sentence."""
    lacking = [one.measure.name for one in found[:BINDING] if not one.complete]
    if lacking:
        return False, f"rows are missing of: {', '.join(lacking)}"
    speaking = [one.speaks_for for one in found]
    ahead = speaking.count(HINDERED) - speaking.count(ALONE)
    lost = [one.measure.name for one in found if one.fails(HINDERED) and not one.fails(ALONE)]
    told = f"{speaking.count(HINDERED)} measures speak for it, {speaking.count(ALONE)} against it"
    if lost:
        told += f"; under it alone fail: {', '.join(lost)}"
    return ahead >= AHEAD and not lost, told
