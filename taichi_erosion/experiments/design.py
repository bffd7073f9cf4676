"""The named designs, for given factors, with their run order and blocks.

With a seed the runs are carried out in random order within blocks; without one, in standard order.
"""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.generate import (
    axial_points,
    box_behnken_points,
    factorial_points,
    fractional_points,
    grid_points,
    latin_hypercube_points,
    plackett_burman_points,
    repeated_centre,
    sobol_points,
)
from taichi_erosion.experiments.optimal import best_additions
from taichi_erosion.experiments.table import (
    Design,
    Factor,
    Floats,
    PointKind,
    arranged,
    refuse_bad_factors,
    to_natural,
)
from taichi_erosion.experiments.terms import Term

__all__ = ["Design", "Factor"]  # and every design below

Part = tuple[PointKind, Floats]
Axial = Literal["rotatable", "spherical", "faced"]


def plackett_burman(
    factors: Sequence[Factor], centre_points: int = 1, fold_over: bool = False, seed: int | None = None
) -> Design:
    """Screening of main effects in the smallest multiple of four runs, in textbook order.

    The fold-over repeats the design with all signs changed, as a second block with centre points of its own;
    main effects are then free of two-factor interactions.

    Reference: Plackett & Burman (1946), Biometrika 33, 305; fold-over: Box & Wilson (1951).
    """
    refuse_bad_factors(factors, 1, "Plackett-Burman")
    points = plackett_burman_points(len(factors))
    first = with_centre(points, centre_points)
    second = with_centre(-points, centre_points) if fold_over else []
    blocks = [1] * len(first) + [2] * len(second)
    return arranged("Plackett-Burman", factors, [*first, *second], seed, blocks)


def full_factorial(
    factors: Sequence[Factor],
    levels: int | Sequence[int] = 2,
    centre_points: int = 0,
    seed: int | None = None,
) -> Design:
    """All combinations of levels, the first factor changing fastest (Yates order)."""
    refuse_bad_factors(factors, 1, "full factorial")
    counts = (levels,) * len(factors) if isinstance(levels, int) else tuple(levels)
    if len(counts) != len(factors) or min(counts) < 2:
        raise BadInput(f"full factorial: levels = {counts}; needs a number above 1 for every factor")
    return arranged("full factorial", factors, with_centre(factorial_points(counts), centre_points), seed)


def fractional_factorial(
    factors: Sequence[Factor], generators: str, centre_points: int = 0, seed: int | None = None
) -> Design:
    """Two-level fraction: "a b c abc" is half of a 2^4; `aliases` says what it cannot tell apart."""
    refuse_bad_factors(factors, 1, "fractional factorial")
    if len(generators.split()) != len(factors):
        raise BadInput(f"fractional factorial: '{generators}' must have one word for each of the factors")
    points = fractional_points(generators)
    return arranged("fractional factorial", factors, with_centre(points, centre_points), seed)


def box_behnken(factors: Sequence[Factor], centre_points: int = 5, seed: int | None = None) -> Design:
    """Quadratic response surface on the midpoints of the edges, in Design-Expert's standard order.

    Reference: Box & Behnken (1960), Technometrics 2, 455.
    """
    refuse_bad_factors(factors, 3, "Box-Behnken")
    edges: Part = ("edge", box_behnken_points(len(factors)))
    return arranged("Box-Behnken", factors, [edges, *centres(len(factors), centre_points)], seed)


def central_composite(
    factors: Sequence[Factor],
    centre_points: int = 5,
    axial: Axial | float = "rotatable",
    generators: str | None = None,
    seed: int | None = None,
) -> Design:
    """Quadratic response surface on a (fractional) factorial, star points and centre.

        alpha = F^(1/4) rotatable,   sqrt(k) spherical,   1 on the faces

    with F the number of factorial runs, k of factors. A factor's low and high are the factorial's; the star
    lies outside of them where alpha > 1.

    Reference: Box & Wilson (1951), J. R. Stat. Soc. B 13, 1; Box & Hunter (1957), Ann. Math. Stat. 28, 195.
    """
    refuse_bad_factors(factors, 2, "central composite")
    count = len(factors)
    corners = fractional_points(generators) if generators else factorial_points((2,) * count)
    known = {"rotatable": len(corners) ** 0.25, "spherical": count**0.5, "faced": 1.0}
    distance = known[axial] if isinstance(axial, str) else float(axial)
    star: Part = ("axial", axial_points(count, distance))
    parts: list[Part] = [("factorial", corners), star, *centres(count, centre_points)]
    return arranged("central composite", factors, parts, seed)


def latin_hypercube(factors: Sequence[Factor], runs: int, seed: int) -> Design:
    """Space filling with one run in every slice of every factor; the seed draws the design and its order."""
    refuse_bad_factors(factors, 1, "Latin hypercube")
    points: Part = ("space", latin_hypercube_points(len(factors), runs, seed))
    return arranged("Latin hypercube", factors, [points])


def sobol(factors: Sequence[Factor], runs: int, seed: int) -> Design:
    """Space filling by a scrambled Sobol sequence; runs is a power of two."""
    refuse_bad_factors(factors, 1, "Sobol")
    return arranged("Sobol", factors, [("space", sobol_points(len(factors), runs, seed))])


def augmented(
    design: Design, terms: Sequence[Term], runs: int, levels: int = 3, seed: int | None = None
) -> Design:
    """The design with `runs` more that make the determinant of X'X largest for a model of these terms.

    The new runs are a block of their own and come last; candidates are the full grid of `levels` levels.
    """
    candidates = grid_points(len(design.factors), levels)
    added: Part = ("added", best_additions(design.coded, candidates, terms, runs))
    block = int(design.blocks.max()) + 1
    extra = arranged(design.name, design.factors, [added], seed, [block])
    missing = np.full(runs, np.nan)
    return Design(
        name=f"{design.name}, augmented",
        factors=design.factors,
        coded=np.concatenate([design.coded, extra.coded]),
        run_order=np.concatenate([design.run_order, len(design) + extra.run_order]),
        blocks=np.concatenate([design.blocks, extra.blocks]),
        kinds=design.kinds + extra.kinds,
        responses={name: np.concatenate([known, missing]) for name, known in design.responses.items()},
    )


def steepest_path(
    factors: Sequence[Factor],
    slopes: Mapping[str, float] | Sequence[float],
    steps: int = 6,
    step: float = 0.4,
    start: ArrayLike | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> Design:
    """Runs along the gradient of a first-order model: steepest climb, or descent with a negative step.

        x_k = x_0 + k step b / max |b|,   k = 0 ... steps - 1

    with b the coded slopes and x the coded levels [1]; `start` is coded and the centre where left out.
    Factors without a slope stay where they start. `limits` hold natural values (a friction below 0 is none);
    a path that meets one ends there, for beyond it the direction would be another.

    Reference: Box & Wilson (1951), J. R. Stat. Soc. B 13, 1; Myers, Montgomery & Anderson-Cook (2016), ch. 5.
    """
    refuse_bad_factors(factors, 1, "steepest path")
    named = (
        slopes if isinstance(slopes, Mapping) else dict(zip((f.path for f in factors), slopes, strict=True))
    )
    gradient = np.array([named.get(factor.path, 0.0) for factor in factors])
    largest = float(np.max(np.abs(gradient)))
    if not (isfinite(largest) and largest > 0.0):
        raise BadInput("steepest path: every slope is 0; there is no direction to climb")
    origin = np.zeros(len(factors)) if start is None else np.asarray(start, dtype=float)
    points: Floats = origin + np.outer(np.arange(steps, dtype=float), step * gradient / largest)
    inside = within(factors, points, limits or {})
    if not inside.any():
        raise BadInput("steepest path: the start lies outside the limits")
    return arranged("steepest path", factors, [("path", points[inside])])


def within(
    factors: Sequence[Factor], points: Floats, limits: Mapping[str, tuple[float, float]]
) -> np.ndarray:
    """Points, from the first on, up to where a limit is passed."""
    natural = to_natural(factors, points)
    inside = np.ones(len(points), dtype=bool)
    for column, factor in enumerate(factors):
        low, high = limits.get(factor.path, (-np.inf, np.inf))
        slack = 1e-9 * factor.half  # a point on the limit is inside, rounding apart
        inside &= (natural[:, column] >= low - slack) & (natural[:, column] <= high + slack)
    return np.logical_and.accumulate(inside)


def with_centre(points: Floats, repeats: int) -> list[Part]:
    """Factorial points and repeats of the centre."""
    return [("factorial", points), *centres(points.shape[1], repeats)]


def centres(count: int, repeats: int) -> list[Part]:
    """Repeats of the centre as a part of a design, or no part."""
    return [("centre", repeated_centre(count, repeats))] if repeats else []
