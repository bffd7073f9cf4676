"""A design: levels of factors run by run, in coded and in natural units, and its CSV table.

    x = (natural - centre) / half,   centre = (high + low) / 2,   half = (high - low) / 2

with x the coded level [1]: -1 at the low, +1 at the high end of a factor's range.

Reference: Box, Hunter & Hunter (2005), Statistics for Experimenters, 2nd ed., ch. 5.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats

PointKind = Literal["factorial", "edge", "axial", "centre", "path", "space", "added"]
SAME_POINT = 1e-9  # coded levels closer than this are one level; they come from decimal numbers [1]


@dataclass(frozen=True)
class Factor:
    """A parameter and the range over which a design varies it, in the parameter's own unit."""

    path: str  # dotted path of a scene's parameter, or any name of a column
    low: float  # coded -1
    high: float  # coded +1
    unit: str = "1"

    def __post_init__(self) -> None:
        """Refuse a range that is none."""
        if not (isfinite(self.low) and isfinite(self.high) and self.low < self.high):
            raise BadInput(f"factor {self.path}: low = {self.low:g}, high = {self.high:g}; needs low < high")

    @property
    def centre(self) -> float:
        """Natural value at the coded level 0."""
        return 0.5 * (self.low + self.high)

    @property
    def half(self) -> float:
        """Natural width of one coded unit."""
        return 0.5 * (self.high - self.low)


@dataclass(frozen=True, eq=False)
class Design:
    """Runs of an experiment, its rows in standard order.

    `run_order[i]` is the turn (from 1) in which row i is carried out; `by_turn` lists rows in that order.
    """

    name: str
    factors: tuple[Factor, ...]
    coded: Floats  # [runs, factors]
    run_order: NDArray[np.int64]  # [runs], 1 ... runs
    kinds: tuple[PointKind, ...]  # [runs]
    responses: dict[str, Floats] = field(default_factory=dict)  # by name, [runs]; NaN where a run failed

    @property
    def natural(self) -> Floats:
        """Levels in the factors' own units, [runs, factors]."""
        return to_natural(self.factors, self.coded)

    @property
    def by_turn(self) -> NDArray[np.int64]:
        """Rows in the order in which they are carried out."""
        return np.argsort(self.run_order, kind="stable")

    def __len__(self) -> int:
        """Number of runs."""
        return len(self.coded)

    def settings(self, row: int) -> dict[str, float]:
        """Natural value of every factor in one row, by path."""
        return settings_at(self.factors, self.coded[row])

    def with_responses(self, **responses: ArrayLike) -> "Design":
        """The design with columns of results, given in standard order."""
        columns = {name: np.asarray(column, dtype=float) for name, column in responses.items()}
        for name, column in columns.items():
            if column.shape != (len(self),):
                raise ValueError(f"response {name}: {column.shape} values for {len(self)} runs")
        return replace(self, responses=self.responses | columns)


def to_natural(factors: Sequence[Factor], coded: ArrayLike) -> Floats:
    """Natural values of coded levels, [..., factors]; -1, 0 and +1 give low, centre and high to the bit."""
    levels = np.asarray(coded, dtype=float)
    low, high, centre, half = np.array([(f.low, f.high, f.centre, f.half) for f in factors]).T
    return np.where(levels == -1.0, low, np.where(levels == 1.0, high, centre + half * levels))


def to_coded(factors: Sequence[Factor], natural: ArrayLike) -> Floats:
    """Coded levels of natural values, [..., factors]."""
    centre, half = np.array([(f.centre, f.half) for f in factors]).T
    return (np.asarray(natural, dtype=float) - centre) / half


def settings_at(factors: Sequence[Factor], coded: Floats) -> dict[str, float]:
    """Natural values of a coded point, by path."""
    return dict(zip((f.path for f in factors), map(float, to_natural(factors, coded)), strict=True))


def arranged(
    name: str, factors: Sequence[Factor], parts: Sequence[tuple[PointKind, Floats]], seed: int | None = None
) -> Design:
    """A design of several parts, one below the other.

    With a seed the runs are carried out in random order, without one in standard order.
    """
    coded = np.concatenate([points for _, points in parts])
    queue = np.arange(len(coded)) if seed is None else np.random.default_rng(seed).permutation(len(coded))
    return Design(
        name=name,
        factors=tuple(factors),
        coded=coded + 0.0,  # a level of -0.0 would print with its sign
        run_order=np.argsort(queue) + 1,
        kinds=tuple(kind for kind, points in parts for _ in points),
    )


def design_frame(design: Design) -> pd.DataFrame:
    """The table, one row a run in standard order: number, turn, kind of point, levels, responses."""
    natural = {f"{f.path} [{f.unit}] {f.low!r}..{f.high!r}": k for k, f in enumerate(design.factors)}
    coded = {f"coded {f.path}": k for k, f in enumerate(design.factors)}
    return pd.DataFrame(
        {"run": np.arange(1, len(design) + 1), "turn": design.run_order, "point": design.kinds}
        | {heading: design.natural[:, k] for heading, k in natural.items()}
        | {heading: design.coded[:, k] for heading, k in coded.items()}
        | design.responses
    )


def design_text(design: Design) -> str:
    """The table as CSV; the cell of a run without a result is empty."""
    return design_frame(design).to_csv(index=False, lineterminator="\n")
