"""Designs: levels of factors run by run, in coded and in natural units, and the designs that are offered.

    x = (natural - centre) / half,   centre = (high + low) / 2,   half = (high - low) / 2

with x the coded level [1]: -1 at the low, +1 at the high end of a factor's range. Rows stand in the order of
the textbooks, which is also that of Design-Expert: the first factor changes fastest. With a seed the runs are
carried out in random order; without one, in standard order.

References: Box, Hunter & Hunter (2005), Statistics for Experimenters, 2nd ed., ch. 5; Plackett & Burman
(1946), Biometrika 33, 305; Box & Behnken (1960), Technometrics 2, 455, table 3; Box & Wilson (1951), J. R.
Stat. Soc. B 13, 1; McKay, Beckman & Conover (1979), Technometrics 21, 239.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.stats import qmc

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats

PointKind = Literal["factorial", "edge", "axial", "centre", "path", "space", "added"]
Part = tuple[PointKind, Floats]
Axial = Literal["rotatable", "spherical", "faced"]
SAME_POINT = 1e-9  # coded levels closer than this are one level; they come from decimal numbers [1]
# first rows of the cyclic designs of Plackett & Burman (1946), by the number of runs; 28 runs are not cyclic
CYCLES = {
    4: "++-",
    8: "+++-+--",
    12: "++-+++---+-",
    16: "++++-+-++--+---",
    20: "++--++++-+-+----++-",
    24: "+++++-+-++--++--+-+----",
    32: "----+-+-+++-++---+++++--++-+--+",
    36: "-+-+++---+++++-+++--+----+-+-++--+-",
}
# factors that are varied together, block by block, in the order of Box & Behnken (1960)
TOGETHER = {
    3: ("AB", "AC", "BC"),
    4: ("AB", "CD", "AD", "BC", "AC", "BD"),
    5: ("AB", "CD", "BE", "AC", "DE", "BC", "AD", "CE", "AE", "BD"),
    6: ("ABD", "BCE", "CDF", "ADE", "BEF", "ACF"),
    7: ("DEF", "AFG", "BEG", "ABD", "CDG", "ACE", "BCF"),
}


@dataclass(frozen=True)
class Factor:
    """A parameter and the range over which a design varies it, in the parameter's own unit."""

    path: str  # dotted path of a scene's parameter, or any name of a column
    low: float  # coded -1
    high: float  # coded +1
    unit: str = "1"

    @property
    def centre(self) -> float:
        """Natural value at the coded level 0."""
        return 0.5 * (self.low + self.high)

    @property
    def half_range(self) -> float:
        """Natural width of one coded unit."""
        return 0.5 * (self.high - self.low)


@dataclass(frozen=True, eq=False)
class Design:
    """Runs of an experiment, its rows in standard order.

    `run_order[i]` is the turn (from 1) in which row i is carried out.
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

    def __len__(self) -> int:
        return len(self.coded)

    def settings(self, row: int) -> dict[str, float]:
        """Natural value of every factor in one row, by path."""
        return settings_at(self.factors, self.coded[row])

    def with_responses(self, **responses: ArrayLike) -> "Design":
        """The design with columns of results, given in standard order."""
        columns = {name: np.asarray(column, dtype=float) for name, column in responses.items()}
        return replace(self, responses=self.responses | columns)


def to_natural(factors: Sequence[Factor], coded: ArrayLike) -> Floats:
    """Natural values of coded levels, [..., factors]; -1, 0 and +1 give low, centre and high to the bit."""
    levels = np.asarray(coded, dtype=float)
    low, high, centre, half = np.array([(f.low, f.high, f.centre, f.half_range) for f in factors]).T
    return np.where(levels == -1.0, low, np.where(levels == 1.0, high, centre + half * levels))


def to_coded(factors: Sequence[Factor], natural: ArrayLike) -> Floats:
    """Coded levels of natural values, [..., factors]."""
    centre, half = np.array([(f.centre, f.half_range) for f in factors]).T
    return (np.asarray(natural, dtype=float) - centre) / half


def settings_at(factors: Sequence[Factor], coded: Floats) -> dict[str, float]:
    """Natural values of a coded point, by path."""
    return dict(zip((f.path for f in factors), map(float, to_natural(factors, coded)), strict=True))


def stack_parts(
    name: str, factors: Sequence[Factor], parts: Sequence[Part], seed: int | None = None, centre: int = 0
) -> Design:
    """A design of several parts, one below the other, and last as many runs in the centre.

    With a seed the runs are carried out in random order, without one in standard order.
    """
    parts = [*parts, ("centre", np.zeros((centre, len(factors))))]
    coded = np.concatenate([points for _, points in parts])
    queue = np.arange(len(coded)) if seed is None else np.random.default_rng(seed).permutation(len(coded))
    kinds: tuple[PointKind, ...] = tuple(kind for kind, points in parts for _ in points)
    # a level of -0.0 would print with its sign
    return Design(name, tuple(factors), coded + 0.0, np.argsort(queue) + 1, kinds)


def design_csv(design: Design) -> str:
    """The table as CSV, one row a run in standard order; the cell of a run without a result is empty."""
    natural = {f"{f.path} [{f.unit}] {f.low!r}..{f.high!r}": k for k, f in enumerate(design.factors)}
    coded = {f"coded {f.path}": k for k, f in enumerate(design.factors)}
    table = pd.DataFrame(
        {"run": np.arange(1, len(design) + 1), "turn": design.run_order, "point": design.kinds}
        | {heading: design.natural[:, k] for heading, k in natural.items()}
        | {heading: design.coded[:, k] for heading, k in coded.items()}
        | design.responses
    )
    return table.to_csv(index=False, lineterminator="\n")


def factorial_points(count: int, levels: int = 3) -> Floats:
    """All combinations of `levels` equidistant levels between -1 and +1."""
    from pyDOE3 import fullfact

    return 2.0 * np.asarray(fullfact([levels] * count), float) / (levels - 1) - 1.0


def plackett_burman(factors: Sequence[Factor], centre_points: int = 1, seed: int | None = None) -> Design:
    """Screening of main effects in the smallest multiple of four runs, in textbook order."""
    count = len(factors)
    sizes = [runs for runs in CYCLES if runs > count]
    if not sizes:
        raise BadInput(f"Plackett-Burman: {count} factors; at most {max(CYCLES) - 1} are allowed")
    first = np.array([1.0 if sign == "+" else -1.0 for sign in CYCLES[sizes[0]]])
    shifts = [np.roll(first, turn) for turn in range(len(first))]  # to the right; then a row of -1
    corners = np.array([*shifts, -np.ones(len(first))])[:, :count]
    return stack_parts("Plackett-Burman", factors, [("factorial", corners)], seed, centre_points)


def box_behnken(factors: Sequence[Factor], centre_points: int = 5, seed: int | None = None) -> Design:
    """Quadratic response surface on the midpoints of the edges, in Design-Expert's standard order."""
    count = len(factors)
    if count not in TOGETHER:
        raise BadInput(f"Box-Behnken: {count} factors; allowed are {min(TOGETHER)} to {max(TOGETHER)}")
    blocks = []
    for letters in TOGETHER[count]:
        corners = factorial_points(len(letters), 2)
        block = np.zeros((len(corners), count))
        block[:, [ord(letter) - ord("A") for letter in letters]] = corners
        blocks.append(block)
    return stack_parts("Box-Behnken", factors, [("edge", np.concatenate(blocks))], seed, centre_points)


def central_composite(
    factors: Sequence[Factor], centre_points: int = 5, axial: Axial = "rotatable", seed: int | None = None
) -> Design:
    """Quadratic response surface on a two-level factorial, star points and centre.

        alpha = F^(1/4) rotatable,   sqrt(k) spherical,   1 on the faces

    with alpha the coded distance of the star points [1], k the number of factors and F = 2^k of factorial
    runs. A factor's low and high are those of the factorial; the star lies outside them where alpha > 1.

    Reference: Box & Wilson (1951), J. R. Stat. Soc. B 13, 1; Box & Hunter (1957), Ann. Math. Stat. 28, 195.
    """
    count = len(factors)
    corners = factorial_points(count, 2)
    alpha = {"rotatable": len(corners) ** 0.25, "spherical": count**0.5, "faced": 1.0}[axial]
    star = alpha * np.stack([-np.eye(count), np.eye(count)], axis=1).reshape(2 * count, count)
    parts: list[Part] = [("factorial", corners), ("axial", star)]
    return stack_parts("central composite", factors, parts, seed, centre_points)


def latin_hypercube(factors: Sequence[Factor], runs: int, seed: int, centre_points: int = 0) -> Design:
    """Space-filling runs, one in each slice of every factor, of low centred discrepancy, and centre points.

    The seed draws the points and the order of the runs.

    Reference: McKay, Beckman & Conover (1979), Technometrics 21, 239.
    """
    sampler = qmc.LatinHypercube(d=len(factors), optimization="random-cd", rng=np.random.default_rng(seed))
    points = 2.0 * sampler.random(runs) - 1.0
    return stack_parts("Latin hypercube", factors, [("space", points)], seed, centre_points)


def steepest_ascent(
    factors: Sequence[Factor],
    slopes: ArrayLike,
    steps: int = 6,
    step: float = 0.4,
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> Design:
    """Runs from the centre along the gradient of a first-order model: climb, or descent with a negative step.

        x_k = k step b / max |b|,   k = 0 ... steps - 1

    with b the coded slopes and x the coded levels [1]. `limits` hold natural values by path (a friction below
    0 is none); a path that meets one ends there, for beyond it the direction would be another.

    Reference: Box & Wilson (1951), J. R. Stat. Soc. B 13, 1; Myers, Montgomery & Anderson-Cook (2016), ch. 5.
    """
    gradient = np.asarray(slopes, dtype=float)
    largest = float(np.max(np.abs(gradient)))
    if not (isfinite(largest) and largest > 0.0):
        raise BadInput("steepest path: every slope is 0; there is no direction to climb")
    points: Floats = np.outer(np.arange(steps, dtype=float), step * gradient / largest)
    bounds = np.array([(limits or {}).get(factor.path, (-np.inf, np.inf)) for factor in factors])
    slack = SAME_POINT * np.array([factor.half_range for factor in factors])  # on the limit is inside
    natural = to_natural(factors, points)
    inside = np.all((natural >= bounds[:, 0] - slack) & (natural <= bounds[:, 1] + slack), axis=1)
    return stack_parts("steepest path", factors, [("path", points[np.logical_and.accumulate(inside)])])
