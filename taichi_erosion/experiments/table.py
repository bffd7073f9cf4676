"""A design: which levels of which factors, run by run, in coded and in natural units.

    x = (natural - centre) / half,   centre = (high + low) / 2,   half = (high - low) / 2

with x the coded level [1]: -1 at the low, +1 at the high end of a factor's range.

Reference: Box, Hunter & Hunter (2005), Statistics for Experimenters, 2nd ed., ch. 5.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_erosion.core.errors import BadInput

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
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
    run_order: Integers  # [runs], 1 ... runs
    blocks: Integers  # [runs], 1 ...
    kinds: tuple[PointKind, ...]  # [runs]
    responses: dict[str, Floats] = field(default_factory=dict)  # by name, [runs]; NaN where a run failed

    @property
    def natural(self) -> Floats:
        """Levels in the factors' own units, [runs, factors]."""
        return to_natural(self.factors, self.coded)

    @property
    def by_turn(self) -> Integers:
        """Rows in the order in which they are carried out."""
        return np.argsort(self.run_order, kind="stable")

    def __len__(self) -> int:
        """Number of runs."""
        return len(self.coded)

    def settings(self, row: int) -> dict[str, float]:
        """Natural value of every factor in one row, by path."""
        return {
            factor.path: float(value) for factor, value in zip(self.factors, self.natural[row], strict=True)
        }

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
    low, high = np.array([f.low for f in factors]), np.array([f.high for f in factors])
    centre, half = np.array([f.centre for f in factors]), np.array([f.half for f in factors])
    return np.where(levels == -1.0, low, np.where(levels == 1.0, high, centre + half * levels))


def to_coded(factors: Sequence[Factor], natural: ArrayLike) -> Floats:
    """Coded levels of natural values, [..., factors]."""
    centre, half = np.array([f.centre for f in factors]), np.array([f.half for f in factors])
    return (np.asarray(natural, dtype=float) - centre) / half


def refuse_bad_factors(factors: Sequence[Factor], fewest: int, design: str) -> None:
    """Raise BadInput for too few factors or one that stands twice."""
    paths = [factor.path for factor in factors]
    twice = [path for path in dict.fromkeys(paths) if paths.count(path) > 1]
    if twice:
        raise BadInput(f"{design}: factor {twice[0]} is named twice")
    if len(paths) < fewest:
        raise BadInput(f"{design}: {len(paths)} factor(s); needs at least {fewest}")


def arranged(
    name: str,
    factors: Sequence[Factor],
    parts: Sequence[tuple[PointKind, Floats]],
    seed: int | None = None,
    blocks: Sequence[int] | None = None,
) -> Design:
    """A design of several parts, one below the other; every part may be a block of its own.

    With a seed the runs are carried out in random order within their blocks, without one in standard order.
    """
    coded = np.concatenate([points for _, points in parts])
    of_part = [1] * len(parts) if blocks is None else blocks
    block = np.repeat(np.array(of_part, dtype=np.int64), [len(points) for _, points in parts])
    return Design(
        name=name,
        factors=tuple(factors),
        coded=coded + 0.0,  # a level of -0.0 would print with its sign
        run_order=run_order(block, seed),
        blocks=block,
        kinds=tuple(kind for kind, points in parts for _ in points),
    )


def run_order(blocks: Integers, seed: int | None) -> Integers:
    """Turn of every row, block after block; shuffled within a block where a seed is given."""
    rows = np.arange(len(blocks))
    if seed is not None:
        rows = np.random.default_rng(seed).permutation(rows)
    queue = rows[np.argsort(blocks[rows], kind="stable")]
    turns = np.empty(len(blocks), dtype=np.int64)
    turns[queue] = np.arange(1, len(blocks) + 1)
    return turns


def replicate_groups(coded: Floats, blocks: Integers | None = None) -> Integers:
    """Number of the distinct point (and block) at which each row was run, [runs]."""
    keys = np.round(coded / SAME_POINT) + 0.0  # -0.0 is the same point; a misprint may lie beyond integers
    if blocks is not None:
        keys = np.column_stack([keys, blocks])
    return np.unique(keys, axis=0, return_inverse=True)[1].ravel()
