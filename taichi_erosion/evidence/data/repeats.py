"""Pure error: what rows of one source under the same conditions say of the scatter, and of a model's misfit.

With w over the variance of a row as stated (or 1), group g of m_g rows, f true over stated sd,

    SS_g = sum_i w_i (z_i - mean_g)^2 ~ f^2 chi^2(nu_g),    nu_g = m_g - 1

A group disagrees grossly where G P(SS > SS_g | the others) < GROSS. The others tell f^2 by their median,
med_g SS_g / q(nu_g), q that of chi^2, as sharp as EFFICIENCY sum nu_g degrees of freedom of a mean; half of
them may be wrong. The row farthest from the median of a group is left out, of a pair both; the rest is

    pure error SS_pe = sum_g SS_g,    lack of fit F = (SS - SS_in) / (n - p - nu_in)  over  SS_pe / nu_pe,

SS the squares of n rows about a model with p numbers, SS_in those of repeats among them about their means.

References: Rousseeuw & Croux (1993), J. Am. Stat. Assoc. 88, 1273 (median as scale, its efficiency); Grubbs
(1969), Technometrics 11, 1 (test of the largest of all); Draper & Smith (1998), Applied Regression Analysis,
2.1 (pure error and lack of fit).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import log, nan

import numpy as np
from scipy import special, stats

from taichi_erosion.evidence.data.problem import Bools, Floats, Integers

GROSS = 1e-4  # chance at which sound repeats of one observable are taken for a mistake
EFFICIENCY = 0.37  # of the median of squares of a normal variate [Rousseeuw & Croux]
NEAREST = 5  # rows of nearest conditions, by whose median a pair is judged: two of them may be wrong
RIGHT_SHARE = 0.8  # of stated sd that are right [1]
RIGHT_SD = 0.05  # of ln(true / stated sd) where it is right
WRONG_MEAN, WRONG_SD = 0.2, 0.4  # of ln(true / stated sd) where it is not


@dataclass(frozen=True)
class Disagreement:
    """Repeats that differ by more than the scatter of the others can explain."""

    observable: str
    lines: tuple[int, ...]  # rows of the table
    suspects: tuple[int, ...]  # of these, those to check
    gap: float  # largest less smallest value, in the observable's unit


def repeated(z: Floats, weight: Floats, cell: Floats) -> tuple[list[Integers], Floats]:
    """Groups of repeats, which have one number in `cell`, and their squares; a NaN leaves a row out."""
    known = np.flatnonzero(np.isfinite(weight) & np.isfinite(z))
    _, number = np.unique(cell[known], return_inverse=True)
    groups = [known[number == k] for k in np.flatnonzero(np.bincount(number) > 1)]
    mean = [np.average(z[rows], weights=weight[rows]) for rows in groups]
    squares = [float(weight[rows] @ (z[rows] - m) ** 2) for rows, m in zip(groups, mean, strict=True)]
    return groups, np.array(squares)


def pure_error(z: Floats, weight: Floats, cell: Floats) -> tuple[float, int]:
    """Squares of all repeats about their means, and their degrees of freedom."""
    groups, squares = repeated(z, weight, cell)
    return float(squares.sum()), sum(rows.size - 1 for rows in groups)


def gross(groups: Sequence[Integers], squares: Floats, stated: bool) -> Bools:
    """Which groups disagree grossly; none where more than a quarter do: then the scatter itself is uneven.

    Without a stated sd repeats that agree differ by the least difference that is seen: values are rounded.
    """
    freedom = np.array([rows.size - 1 for rows in groups])
    if not squares.any():
        return np.zeros(freedom.size, dtype=np.bool_)
    if not stated:
        squares = np.maximum(squares, np.min(squares, where=squares > 0.0, initial=np.inf))
    typical, found = squares / special.chdtri(freedom, 0.5), np.zeros(freedom.size, dtype=np.bool_)
    for k, own in enumerate(freedom):
        others = np.repeat(np.delete(typical, k), np.delete(freedom, k))
        sharp, scale, chance = EFFICIENCY * others.size, float(np.median(others)) if others.size else 0.0, 1.0
        if stated:
            grid, share = factors(scale * sharp, sharp)
            chance = float(share @ special.chdtrc(own, squares[k] * np.exp(-2.0 * grid)))
        elif sharp:
            rest = np.delete(squares, k).sum() / others.size  # few groups: their mean is sharper
            each = ((sharp, scale), (others.size, rest))
            chance = min(float(special.fdtrc(own, nu, squares[k] / own / size)) for nu, size in each)
        found[k] = chance * freedom.size < GROSS
    return found & (found.sum() <= max(1, freedom.size // 4))


def factors(squares: float, freedom: float) -> tuple[Floats, Floats]:
    """Grid of ln(true / stated sd) and its probabilities, given squares of repeats over stated variances.

    Most statements are right to a few percent, some are wrong by a factor (an instrument's error given for
    the scatter of samples, a standard error for an sd); under the mixture eight repeats do not overrule a
    good statement by their own chance, and do overrule a bad one.
    """
    grid = np.linspace(-1.2, 1.6, 281)
    right = log(RIGHT_SHARE / RIGHT_SD) - 0.5 * (grid / RIGHT_SD) ** 2
    wrong = log((1.0 - RIGHT_SHARE) / WRONG_SD) - 0.5 * ((grid - WRONG_MEAN) / WRONG_SD) ** 2
    weight = np.logaddexp(right, wrong) - freedom * grid - 0.5 * squares * np.exp(-2.0 * grid)
    weight = np.exp(weight - weight.max())
    return grid, weight / weight.sum()


def disagreeing(z: Floats, weights: Sequence[Floats], cell: Floats, stated: bool) -> Bools:
    """Rows that disagree grossly with their repeats, under every one of some weights; both rows of a pair."""
    off = np.zeros(z.size, dtype=np.bool_)
    while True:
        ways = [repeated(np.where(off, nan, z), weight, cell) for weight in weights]
        bad = np.all([gross(*way, stated) for way in ways], axis=0)
        if not bad.any():
            return off
        for k in np.flatnonzero(bad):
            rows = ways[0][0][k]
            off[rows if rows.size == 2 else farthest(z, rows, rows)] = True


def farthest(z: Floats, rows: Integers, others: Integers) -> Integers:
    """The row farthest from the median of others; all where it lies less than twice as far as the nearest."""
    away = np.abs(z[rows] - np.median(z[others]))
    return rows[[np.argmax(away)]] if away.max() > 2.0 * away.min() else rows


def suspects(z: Floats, rows: Integers, off: Bools, conditions: Sequence[Floats]) -> Integers:
    """Rows of a group to check; of a pair the one farthest from those of the nearest conditions, by ranks."""
    sound = np.flatnonzero(~off & np.isfinite(z))
    if not off[rows].all() or not sound.size:
        return rows[off[rows]]
    ranks = [stats.rankdata(np.nan_to_num(column)) for column in conditions]
    far = np.sum([(rank[sound] - rank[rows[0]]) ** 2 for rank in ranks], axis=0) + np.zeros(sound.size)
    return farthest(z, rows, sound[np.argsort(far, kind="stable")[:NEAREST]])


def lack_of_fit(parts: Iterable[tuple[float, float, float, float]]) -> float:
    """Chance that repeats scatter as far as their means lie from a model; NaN where nothing is repeated.

    `parts`, by observable: SS - SS_in, n - p - nu_in, SS_pe and nu_pe; one F test for all of them together.
    """
    tested = [part for part in parts if min(part[1], part[3]) > 0.0]
    if not tested:
        return nan
    squares, dof, error, repeats = np.sum(tested, axis=0)
    ratio = max(squares, 0.0) / dof / max(error / repeats, 1e-300)
    return float(stats.f.sf(ratio, dof, repeats))
