"""Coded points of the named designs, [runs, factors]: the only module that knows pyDOE3 and scipy.stats.qmc.

Rows stand in the order of the textbooks, which is also that of Design-Expert: the first factor changes
fastest.

References: Plackett & Burman (1946), Biometrika 33, 305; Box & Behnken (1960), Technometrics 2, 455, table 3;
Box & Wilson (1951), J. R. Stat. Soc. B 13, 1.

D-optimal runs: those that make the determinant of X'X largest.

    det(X'X + x x') = det(X'X) (1 + d),   d = x' (X'X)^-1 x

so a run is worth adding where the variance d of the prediction is largest; afterwards every added run is
exchanged for a better one until none is left. The optimum is a local one.

Reference: Fedorov (1972), Theory of Optimal Experiments; Mitchell (1974), Technometrics 16, 203.

The named designs, for given factors, with their run order and blocks.

With a seed the runs are carried out in random order within blocks; without one, in standard order.
"""

from collections.abc import Mapping, Sequence
from itertools import product
from math import isfinite
from typing import Literal

import numpy as np
import pyDOE3
from numpy.typing import ArrayLike
from pyDOE3.doe_star import star
from scipy.stats import qmc

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.design_table import (
    Design,
    Factor,
    Floats,
    PointKind,
    arranged,
    refuse_bad_factors,
    to_natural,
)
from taichi_erosion.experiments.terms import Term, model_matrix

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


def factorial_points(levels: tuple[int, ...]) -> Floats:
    """All combinations of equidistant levels between -1 and +1."""
    steps = np.array(levels) - 1.0
    return 2.0 * pyDOE3.fullfact(list(levels)) / steps - 1.0


def fractional_points(generators: str) -> Floats:
    """Two-level fraction; `generators` such as "a b c -abc" give every factor as a product of basic ones."""
    words = generators.split()
    basic = sorted({letter for word in words for letter in word.strip("+-")})
    # pyDOE3 changes the last basic letter fastest: handed over backwards, the first one does
    swap = str.maketrans("".join(basic), "".join(reversed(basic)))
    return np.asarray(pyDOE3.fracfact(" ".join(word.translate(swap) for word in words)), dtype=float)


def box_behnken_points(count: int) -> Floats:
    """Edge midpoints of Box and Behnken without centre points; 3 to 7 factors."""
    if count not in TOGETHER:
        allowed = f"{min(TOGETHER)} to {max(TOGETHER)}"
        raise BadInput(f"Box-Behnken: {count} factors; allowed are {allowed}")
    blocks = []
    for letters in TOGETHER[count]:
        corners = factorial_points((2,) * len(letters))
        block = np.zeros((len(corners), count))
        block[:, [ord(letter) - ord("A") for letter in letters]] = corners
        blocks.append(block)
    return np.concatenate(blocks)


def axial_points(count: int, distance: float) -> Floats:
    """The low and the high star point of every factor."""
    return distance * np.asarray(star(count)[0], dtype=float)


def repeated_centre(count: int, repeats: int) -> Floats:
    """Repeats of the centre."""
    return np.zeros((repeats, count))


def latin_hypercube_points(count: int, runs: int, seed: int) -> Floats:
    """Latin hypercube of low discrepancy: every factor has one run in each of `runs` equal slices."""
    sampler = qmc.LatinHypercube(d=count, optimization="random-cd", rng=np.random.default_rng(seed))
    return 2.0 * sampler.random(runs) - 1.0


def sobol_points(count: int, runs: int, seed: int) -> Floats:
    """Scrambled Sobol sequence; only a power of two keeps its balance."""
    power = runs.bit_length() - 1
    if runs < 1 or runs != 2**power:
        raise BadInput(f"Sobol: {runs} runs; must be a power of two such as {2 ** (power + 1)}")
    sampler = qmc.Sobol(d=count, rng=np.random.default_rng(seed))
    return 2.0 * sampler.random_base2(power) - 1.0


def grid_points(count: int, levels: int = 3) -> Floats:
    """Candidates for optimal designs: the full grid of `levels` levels."""
    ticks = np.linspace(-1.0, 1.0, levels)
    return np.array([point[::-1] for point in product(ticks, repeat=count)])


RIDGE = 1e-6  # keeps X'X invertible until enough runs are there; no effect on which full-rank set is best [1]
WORTHWHILE = 1e-9  # relative gain of the determinant below which no run is exchanged [1]


def best_additions(present: Floats, candidates: Floats, terms: Sequence[Term], runs: int) -> Floats:
    """Candidates to add to the points that are present, [runs, factors]."""
    if runs < 1:
        raise BadInput(f"D-optimal: {runs} added runs; needs at least 1")
    fixed, choices = model_matrix(present, terms), model_matrix(candidates, terms)
    information = fixed.T @ fixed + RIDGE * np.eye(choices.shape[1])
    chosen: list[int] = []
    for _ in range(runs):
        chosen.append(worthiest(information, choices)[0])
        information = information + np.outer(choices[chosen[-1]], choices[chosen[-1]])
    exchange(information, choices, chosen)
    points = candidates[chosen]
    if np.linalg.matrix_rank(model_matrix(np.concatenate([present, points]), terms)) < choices.shape[1]:
        raise BadInput(
            f"D-optimal: {len(present)} + {runs} runs cannot fit {choices.shape[1]} coefficients; add more"
        )
    return points


def worthiest(information: Floats, choices: Floats) -> tuple[int, float]:
    """Candidate of the largest variance d, and d."""
    variance = np.einsum("ij,ji->i", choices, np.linalg.solve(information, choices.T))
    best = int(np.argmax(variance))
    return best, float(variance[best])


def exchange(information: Floats, choices: Floats, chosen_out: list[int]) -> None:
    """Take out each chosen run and put in the best one, until a whole round changes nothing."""
    changed = True
    while changed:
        changed = False
        for place, old in enumerate(chosen_out):
            without = information - np.outer(choices[old], choices[old])
            new, worth = worthiest(without, choices)
            kept = float(choices[old] @ np.linalg.solve(without, choices[old]))
            if worth > kept + WORTHWHILE * (1.0 + kept):
                chosen_out[place], changed = new, True
                information = without + np.outer(choices[new], choices[new])


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
