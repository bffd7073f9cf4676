"""Designs that the program offers: points in coded levels [runs, factors], run order and blocks.

Rows stand in the order of the textbooks, which is also that of Design-Expert: the first factor changes
fastest. With a seed the runs are carried out in random order; without one, in standard order.

References: Plackett & Burman (1946), Biometrika 33, 305; Box & Behnken (1960), Technometrics 2, 455, table 3;
Box & Wilson (1951), J. R. Stat. Soc. B 13, 1; McKay, Beckman & Conover (1979), Technometrics 21, 239.
"""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import qmc

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats
from taichi_erosion.experiments.design_table import (
    SAME_POINT,
    Design,
    Factor,
    PointKind,
    arranged,
    to_natural,
)

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


def plackett_burman_points(count: int) -> Floats:
    """Smallest Plackett-Burman design: right shifts of its first row, then a row of -1."""
    sizes = [runs for runs in CYCLES if runs > count]
    if not sizes:
        raise BadInput(f"Plackett-Burman: {count} factors; at most {max(CYCLES) - 1} are allowed")
    first = np.array([1.0 if sign == "+" else -1.0 for sign in CYCLES[sizes[0]]])
    shifts = [np.roll(first, turn) for turn in range(len(first))]
    return np.array([*shifts, -np.ones(len(first))])[:, :count]


def box_behnken_points(count: int) -> Floats:
    """Edge midpoints of Box and Behnken without centre points; 3 to 7 factors."""
    if count not in TOGETHER:
        allowed = f"{min(TOGETHER)} to {max(TOGETHER)}"
        raise BadInput(f"Box-Behnken: {count} factors; allowed are {allowed}")
    blocks = []
    for letters in TOGETHER[count]:
        corners = grid_points(len(letters), 2)
        block = np.zeros((len(corners), count))
        block[:, [ord(letter) - ord("A") for letter in letters]] = corners
        blocks.append(block)
    return np.concatenate(blocks)


def grid_points(count: int, levels: int = 3) -> Floats:
    """All combinations of `levels` equidistant levels between -1 and +1."""
    from pyDOE3 import fullfact

    return 2.0 * np.asarray(fullfact([levels] * count), float) / (levels - 1) - 1.0


Part = tuple[PointKind, Floats]
Axial = Literal["rotatable", "spherical", "faced"]


def plackett_burman(factors: Sequence[Factor], centre_points: int = 1, seed: int | None = None) -> Design:
    """Screening of main effects in the smallest multiple of four runs, in textbook order.

    Reference: Plackett & Burman (1946), Biometrika 33, 305.
    """
    corners: Part = ("factorial", plackett_burman_points(len(factors)))
    return arranged("Plackett-Burman", factors, [corners, centres(len(factors), centre_points)], seed)


def box_behnken(factors: Sequence[Factor], centre_points: int = 5, seed: int | None = None) -> Design:
    """Quadratic response surface on the midpoints of the edges, in Design-Expert's standard order.

    Reference: Box & Behnken (1960), Technometrics 2, 455.
    """
    edges: Part = ("edge", box_behnken_points(len(factors)))
    return arranged("Box-Behnken", factors, [edges, centres(len(factors), centre_points)], seed)


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
    corners = grid_points(count, 2)
    alpha = {"rotatable": len(corners) ** 0.25, "spherical": count**0.5, "faced": 1.0}[axial]
    star = alpha * np.stack([-np.eye(count), np.eye(count)], axis=1).reshape(2 * count, count)
    parts: list[Part] = [("factorial", corners), ("axial", star), centres(count, centre_points)]
    return arranged("central composite", factors, parts, seed)


def latin_hypercube(factors: Sequence[Factor], runs: int, seed: int, centre_points: int = 0) -> Design:
    """Space-filling runs, one in each slice of every factor, of low centred discrepancy, and centre points.

    The seed draws the points and the order of the runs.

    Reference: McKay, Beckman & Conover (1979), Technometrics 21, 239.
    """
    count = len(factors)
    sampler = qmc.LatinHypercube(d=count, optimization="random-cd", rng=np.random.default_rng(seed))
    points: Part = ("space", 2.0 * sampler.random(runs) - 1.0)
    return arranged("Latin hypercube", factors, [points, centres(count, centre_points)], seed)


def steepest_path(
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
    slack = SAME_POINT * np.array([factor.half for factor in factors])  # on the limit is inside
    natural = to_natural(factors, points)
    inside = np.all((natural >= bounds[:, 0] - slack) & (natural <= bounds[:, 1] + slack), axis=1)
    if not inside[0]:
        raise BadInput("steepest path: the start lies outside the limits")
    return arranged("steepest path", factors, [("path", points[np.logical_and.accumulate(inside)])])


def centres(count: int, repeats: int) -> Part:
    """Repeats of the centre."""
    return "centre", np.zeros((repeats, count))
