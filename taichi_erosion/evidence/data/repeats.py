"""Pure error: what rows of one source under the same conditions say of the scatter, and of a model's misfit.

With w over the variance of a row as stated (or 1), group g of m_g rows, f true over stated sd,

    SS_g = sum_i w_i (z_i - mean_g)^2 ~ f^2 chi^2(nu_g),    nu_g = m_g - 1

A group disagrees grossly where G P(SS > SS_g | the others) < GROSS. The others tell f by their median,
s^2 = med_g SS_g / q(nu_g), q the median of chi^2, as sharp as EFFICIENCY sum nu_g degrees of freedom of a
mean; half of them may be wrong. The pure error is the sum of SS_g over the groups that do not disagree.

    lack of fit:  F = (SS - SS_within) / (n - p - nu_within)  over  SS_pe / nu_pe

SS: squares of n rows about a model with p numbers, SS_within those of repeats among them about their means.

References: Rousseeuw & Croux (1993), J. Am. Stat. Assoc. 88, 1273 (median as scale, its efficiency); Grubbs
(1969), Technometrics 11, 1 (test of the largest of all); Draper & Smith (1998), Applied Regression Analysis,
2.1 (pure error and lack of fit).
"""

from collections.abc import Mapping, Sequence
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
class Group:
    """Rows of one source under the same conditions."""

    rows: Integers
    squares: float  # about their mean, over their variances

    @property
    def freedom(self) -> int:
        return self.rows.size - 1


@dataclass(frozen=True)
class Disagreement:
    """Repeats that differ by more than the scatter of the others can explain."""

    observable: str
    lines: tuple[int, ...]  # rows of the table
    suspects: tuple[int, ...]  # of these, the one to check; all where nothing tells which
    gap: float  # largest less smallest value, in the observable's unit


@dataclass(frozen=True)
class PureError:
    """Scatter between the repeats of one observable."""

    ratio: float  # its variance over that of the rows; NaN without repeats
    freedom: float


NO_REPEATS = PureError(nan, 0.0)


@dataclass(frozen=True)
class LackOfFit:
    """Whether a model misses means of repeats by more than repeats differ."""

    ratio: float  # F
    freedom: float  # of the misfit
    pure_freedom: float
    p: float


def repeated(z: Floats, weight: Floats, cell: Floats) -> list[Group]:
    """Groups of repeats; `cell` is equal for rows that repeat one another, no weight leaves a row out."""
    known = np.flatnonzero(np.isfinite(weight) & np.isfinite(z))
    _, number = np.unique(cell[known], return_inverse=True)
    found = [known[number == k] for k in np.flatnonzero(np.bincount(number) > 1)]
    return [Group(rows, squares_about_mean(z[rows], weight[rows])) for rows in found]


def squares_about_mean(z: Floats, weight: Floats) -> float:
    """Weighted squares about the weighted mean."""
    return float(weight @ (z - np.average(z, weights=weight)) ** 2)


def pooled(groups: Sequence[Group]) -> tuple[float, int]:
    """Squares and degrees of freedom of several groups."""
    return float(sum(group.squares for group in groups)), sum(group.freedom for group in groups)


def gross(groups: Sequence[Group], stated: bool) -> list[bool]:
    """Which groups disagree grossly; none where so many do that the scatter itself is uneven.

    Without a stated sd repeats that agree are taken to differ by the least difference that is seen: values
    are rounded.
    """
    if not groups:
        return []
    freedom = np.array([group.freedom for group in groups])
    squares = np.array([group.squares for group in groups])
    if not stated:
        squares = np.maximum(squares, np.min(squares, where=squares > 0.0, initial=np.inf))
    typical = squares / special.chdtri(freedom, 0.5)
    found = []
    for k, own in enumerate(freedom):
        others = np.arange(freedom.size) != k
        sharp = EFFICIENCY * float(freedom[others].sum())
        scale = float(np.median(np.repeat(typical[others], freedom[others]))) if sharp else nan
        chance = predicted_tail(float(squares[k]), int(own), scale, sharp, stated)
        found.append(chance * freedom.size < GROSS)
    return found if sum(found) <= max(1, len(groups) // 4) else [False] * len(groups)


def predicted_tail(squares: float, freedom: int, scale: float, sharp: float, stated: bool) -> float:
    """Chance of larger squares where other repeats give a variance with so many degrees of freedom."""
    if stated:
        grid, share = factors(scale * sharp if sharp else 0.0, sharp)
        return float(share @ special.chdtrc(freedom, squares * np.exp(-2.0 * grid)))
    return float(stats.f.sf(squares / freedom / scale, freedom, sharp)) if sharp else 1.0


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


def parted(z: Floats, weights: Sequence[Floats], cell: Floats, stated: bool) -> Bools:
    """Rows that disagree grossly with their repeats, under every one of some weights; both rows of a pair."""
    off = np.zeros(z.size, dtype=np.bool_)
    while True:
        left = np.where(off, nan, z)
        each_way = [repeated(left, weight, cell) for weight in weights]
        found = zip(each_way[0], *(gross(groups, stated) for groups in each_way), strict=True)
        if not (bad := [group.rows for group, *ways in found if all(ways)]):
            return off
        for rows in bad:
            off[rows if rows.size == 2 else farthest(z, rows, float(np.median(z[rows])))] = True


def farthest(z: Floats, rows: Integers, middle: float) -> Integers:
    """The row farthest from some value; all of them where it lies less than twice as far as the nearest."""
    away = np.abs(z[rows] - middle)
    return rows[[np.argmax(away)]] if away.max() > 2.0 * away.min() else rows


def suspects(z: Floats, rows: Integers, off: Bools, ranks: Floats) -> Integers:
    """Rows of a group to check; of a pair the one farthest from the median of its sound neighbours.

    `ranks` (n, c) are those of the conditions.
    """
    if not off[rows].all():
        return rows[off[rows]]
    far = np.where(off | np.isnan(z), np.inf, np.sum((ranks - ranks[rows[0]]) ** 2, axis=1))
    near = np.argsort(far, kind="stable")[:NEAREST]
    near = near[np.isfinite(far[near])]
    return farthest(z, rows, float(np.median(z[near]))) if near.size else rows


def lack_of_fit(
    misfit: Mapping[str, tuple[float, float]],
    within: Mapping[str, Sequence[Group]],
    pure: Mapping[str, PureError],
) -> dict[str, LackOfFit]:
    """Test of every observable that has repeats, and of all of them together under the name ''.

    `misfit`: squares about the model and the degrees of freedom that it leaves; `within`: repeats among the
    same rows.
    """
    parts = {}
    for name, (squares, freedom) in misfit.items():
        own, count = pooled(within[name])
        if pure[name].freedom > 0.0 and freedom > count:
            error = pure[name].ratio * pure[name].freedom
            parts[name] = np.array([max(squares - own, 0.0), freedom - count, error, pure[name].freedom])
    whole = {"": np.sum(list(parts.values()), axis=0)} if parts else {}
    return {name: tested(*map(float, each)) for name, each in (whole | parts).items()}


def tested(squares: float, freedom: float, error: float, pure_freedom: float) -> LackOfFit:
    """F test of two sums of squares."""
    ratio = squares / freedom / max(error / pure_freedom, 1e-300)
    return LackOfFit(ratio, freedom, pure_freedom, float(stats.f.sf(ratio, freedom, pure_freedom)))
