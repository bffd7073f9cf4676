"""Coded points of the named designs, [runs, factors]: the only module that knows pyDOE3 and scipy.stats.qmc.

Rows stand in the order of the textbooks, which is also that of Design-Expert: the first factor changes
fastest.

References: Plackett & Burman (1946), Biometrika 33, 305; Box & Behnken (1960), Technometrics 2, 455, table 3;
Box & Wilson (1951), J. R. Stat. Soc. B 13, 1.
"""

from itertools import product

import numpy as np
import pyDOE3
from pyDOE3.doe_star import star
from scipy.stats import qmc

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.table import Floats

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
