"""Scatter of measurements: stated, measured by repeats, and the one checked against the other.

Pure error is what rows of one source under the same conditions say of the scatter, and of a model's misfit.
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
from math import exp, log, nan, sqrt

import numpy as np
import scipy
from scipy import special

from taichi_erosion.evidence.data.problem import Bools, Floats, Integers

LEAST_FREEDOM = 3  # degrees of freedom from which repeats alone are believed
ROUNDED = 1e-12  # squares over the variance of all, which rounding leaves of equal repeats
UNEVEN = 0.01  # chance below which sample variances are taken to differ in truth
LEAST_VARIANCE = 1e-3  # of the typical one, that any sample variance is taken to be
SHAPE_GAIN = 1.0  # ln likelihood by which another way of the scatter must be better
LEAST_SHAPE = 0.5  # of the typical sd
LEAST_PRIOR, MOST_PRIOR = 4.0, 1e6  # of nu_0, degrees of freedom of the common level
GROSS = 1e-4  # chance at which sound repeats of one observable are taken for a mistake
EFFICIENCY = 0.37  # of the median of squares of a normal variate [Rousseeuw & Croux]
NEAREST = 5  # rows of nearest conditions, by whose median a pair is judged: two of them may be wrong
RIGHT_SHARE = 0.8  # of stated sd that are right [1]
RIGHT_SD = 0.05  # of ln(true / stated sd) where it is right
WRONG_MEAN, WRONG_SD = 0.2, 0.4  # of ln(true / stated sd) where it is not


@dataclass(frozen=True)
class Scatter:
    """Variance of single repeats, row by row, on the comparison scale; NaN where it is unknown."""

    variance: Floats
    freedom: float  # degrees of freedom by which repeated rows check it
    own_freedom: float  # degrees of freedom of the sample variances that it is made of
    factor: float  # scatter between repeated rows over stated scatter; NaN without repeated rows
    p: float  # of a factor as far from 1 by chance; NaN without repeated rows
    pure: tuple[float, float]  # squares between repeats over these variances, degrees of freedom
    off: Bools  # rows that disagree grossly with their repeats
    by_blocks: bool = False  # set-ups stand for repeats


@dataclass(frozen=True)
class ObservableNoise:
    """Noise of one observable on its comparison scale: medians over its rows, and its scatter."""

    lab: float  # standard error of a row
    numerical: float  # tolerance of the model
    scatter: Scatter


@dataclass(frozen=True)
class Disagreement:
    """Repeats that differ by more than the scatter of the others can explain."""

    observable: str
    lines: tuple[int, ...]  # rows of the table
    suspects: tuple[int, ...]  # of these, those to check
    gap: float  # largest less smallest value, in the observable's unit


def moderate_variance(variance: Floats, freedom: Floats, shapes: Floats) -> tuple[Floats, float]:
    """Moderated variances of few repeats, shrunk to their common level, and the degrees of freedom behind it.

        s~_i^2 = (nu_0 s_0i^2 + nu_i s_i^2) / (nu_0 + nu_i) (nu_0 + nu_i) / (nu_0 + nu_i - 2)

    Three repeats give an sd that is wrong by half, and weights made of it give false alarms. So rows share
    one level unless they differ by more than chance, when nu_0 comes from the spread of all s_i^2; the last
    factor is the variance of the t distribution that a residual over such an s~_i has.

    Reference: Smyth (2004), Stat. Appl. Genet. Mol. Biol. 3(1), 3, section 6.2.
    """
    positive = variance[variance > 0.0]
    if positive.size == 0:
        return np.full(variance.size, np.nan), 0.0
    shape = likeliest_scatter_shape(variance, freedom, shapes) ** 2
    relative = np.maximum(variance / shape, LEAST_VARIANCE * np.median(positive / shape[variance > 0.0]))
    whole = float(np.sum(freedom))
    pooled = float(np.sum(freedom * variance / shape)) / whole
    even = pooled * shape * whole / max(whole - 2.0, 1.0), whole
    if variance.size < 2 or equal_variance_p(relative, freedom) > UNEVEN:
        return even
    level = np.log(relative) - special.digamma(freedom / 2.0) + np.log(freedom / 2.0)
    spread = float(np.var(level, ddof=1))
    excess = spread - float(np.mean(special.polygamma(1, freedom / 2.0)))
    if excess <= 0.0:
        return even
    ends = 0.5 * LEAST_PRIOR, MOST_PRIOR  # trigamma(nu_0 / 2) = excess, with nu_0 from LEAST_PRIOR up
    least, most = (float(special.polygamma(1, end)) for end in ends[::-1])
    target = min(max(excess, least), most)
    root = scipy.optimize.root_scalar(lambda y: float(special.polygamma(1, y)) - target, bracket=ends)
    prior = 2.0 * float(root.root)
    total = prior + freedom
    common = np.exp(level.mean() + special.digamma(prior / 2.0) - log(prior / 2.0))
    mixed = (prior * common + freedom * relative) / total
    return shape * mixed * total / (total - 2.0), 2.0 * variance.size / spread


def likeliest_scatter_shape(variance: Floats, freedom: Floats, shapes: Floats) -> Floats:
    """Variation of the scatter over the rows: the first of the shapes (k, n) unless another is much likelier.

        ln L = -1/2 sum nu_i ln(s_0^2 h_i^2),    s_0^2 = sum nu_i s_i^2 / h_i^2 / sum nu_i

    No row is given less than LEAST_SHAPE of the typical sd: a value near zero has more than a relative error.
    """
    bounded = normalise_scatter_shapes(shapes)
    pooled = np.sum(freedom * variance / bounded**2, axis=1) / np.sum(freedom)
    fit = -0.5 * (np.sum(freedom) * np.log(pooled) + np.sum(freedom * np.log(bounded**2), axis=1))
    best = int(np.argmax(fit))
    return bounded[best if fit[best] > fit[0] + SHAPE_GAIN else 0]


def normalise_scatter_shapes(shapes: Floats) -> Floats:
    """Shapes (k, n) over their typical values, none below LEAST_SHAPE of it."""
    usual = np.median(shapes, axis=1, keepdims=True)
    return np.maximum(shapes / np.where(usual > 0.0, usual, 1.0), LEAST_SHAPE)


def equal_variance_p(variance: Floats, freedom: Floats) -> float:
    """Chance that sample variances of equal scatters differ as much.

    Reference: Bartlett (1937), Proc. R. Soc. A 160, 268.
    """
    total = float(np.sum(freedom))
    pooled = log(float(np.sum(freedom * variance)) / total)
    statistic = total * pooled - float(np.sum(freedom * np.log(variance)))
    correction = 1.0 + (float(np.sum(1.0 / freedom)) - 1.0 / total) / (3.0 * (variance.size - 1))
    return float(special.chdtrc(variance.size - 1, max(statistic, 0.0) / correction))


def measurement_scatter(
    z: Floats, sd: Floats, repeats: Floats, cell: Floats, shapes: Floats, design: Floats | None = None
) -> Scatter:
    """Scatter of the rows of one observable.

    `cell` is equal for rows that repeat one another; `shapes` are the ways in which sd may vary over the
    rows, on the comparison scale, the likeliest first. `design` (4, n) numbers each row's set-up under its
    conditions, block, set-up and conditions: where neither sd nor repeats state the scatter, it is what
    levels of the first two leave, else, of three set-ups and more, those of the last three, each set-up
    with a slope of its own along the means of the conditions.
    """
    variance = np.where(sd > 0.0, sd, np.nan) ** 2
    sampled = np.isfinite(variance) & (repeats >= 2.0)
    samples = variance[sampled], repeats[sampled] - 1.0, shapes[:, sampled]
    variance[sampled], own_variance = moderate_variance(*samples)
    finite = np.isfinite(variance)
    if finite.any():
        off = rows_against_repeats(z, [weight := repeats / variance], cell, True)
        squares, between = pure_error_squares(np.where(off, nan, z), weight, cell)
        variance = np.where(finite, variance, np.nanmedian(variance))
        return scale_variance_by_repeats(variance, squares, between, own_variance, off)
    off = rows_against_repeats(z, list(repeats / normalise_scatter_shapes(shapes) ** 2), cell, False)
    squares, freedom = pure_error_squares(np.where(off, nan, z), repeats, cell)
    by_blocks = False
    if design is not None and freedom < LEAST_FREEDOM and np.isfinite(z).any():
        squares, freedom = block_design_squares(z, repeats, design[:2])
        if by_blocks := freedom < LEAST_FREEDOM and bool(design[2].max(initial=0.0) > 1.0):
            squares, freedom = block_design_squares(z, repeats, design[1:], responding=design[2])
    if freedom >= LEAST_FREEDOM and squares > ROUNDED * float(np.nanvar(z)):
        # the variance of the t distribution that a residual over the measured scatter has
        variance, own_variance = np.full(z.size, squares / (freedom - 2.0)), float(freedom)
    pure = max(own_variance - 2.0, 0.0), own_variance
    return Scatter(variance, 0.0, own_variance, nan, nan, pure, off, by_blocks)


def block_design_squares(
    z: Floats, weight: Floats, design: Floats, responding: Floats | None = None
) -> tuple[float, int]:
    """Squares that levels of set-ups and of blocks leave, and their degrees of freedom.

    `responding`: blocks that may follow the last levels in their own proportions, b_i + s_i m_j.

    References: Montgomery (2013), Design and Analysis of Experiments, 4.1 (randomised blocks); Mandel (1961),
    J. Am. Stat. Assoc. 56, 878 (a slope for each block).
    """
    finite = np.isfinite(z)
    masks = [(column[:, np.newaxis] == np.unique(column[finite]))[finite] for column in design]
    root = np.sqrt(weight[finite])[:, np.newaxis]
    y, levels = root[:, 0] * z[finite], root * np.hstack(masks)
    best, _, rank, _ = np.linalg.lstsq(levels, y)
    if responding is not None:
        mean = masks[-1] @ best[-masks[-1].shape[1] :]
        blocks = (responding[:, np.newaxis] == np.unique(responding[finite]))[finite]
        levels = np.hstack([levels, root * blocks * (mean - mean.mean())[:, np.newaxis]])
        best, _, rank, _ = np.linalg.lstsq(levels, y, rcond=1e-9)
    return float(np.sum((y - levels @ best) ** 2)), int(y.size - rank)


def scale_variance_by_repeats(
    variance: Floats, squares: float, between: int, own_variance: float, off: Bools
) -> Scatter:
    """Stated variances, scaled by the scatter of repeated rows: SS_pe ~ chi^2(nu) if they are right."""
    if between == 0 or squares < 1e-12:  # equal repeats tell no scatter
        return Scatter(variance, 0.0, own_variance, nan, nan, (0.0, 0.0), off)
    factor = sqrt(squares / between)
    tail = float(special.chdtrc(between, squares))
    grid, share = sd_factor_distribution(squares, between)
    scale = exp(2.0 * float(share @ grid))  # of exp E[ln f]
    p, pure = min(1.0, 2.0 * min(tail, 1.0 - tail)), (squares / scale, float(between))
    return Scatter(variance * scale, float(between), own_variance, factor, p, pure, off)


def group_repeats(z: Floats, weight: Floats, cell: Floats) -> tuple[list[Integers], Floats]:
    """Groups of repeats, of one number in `cell`, and their squares, 0 if all are equal; NaN: left out."""
    finite = np.flatnonzero(np.isfinite(weight) & np.isfinite(z))
    _, number = np.unique(cell[finite], return_inverse=True)
    groups = [finite[number == k] for k in np.flatnonzero(np.bincount(number) > 1)]
    above = [(z[rows] - z[rows[0]], weight[rows]) for rows in groups]
    return groups, np.array([float(w @ (d - np.average(d, weights=w)) ** 2) for d, w in above])


def pure_error_squares(z: Floats, weight: Floats, cell: Floats) -> tuple[float, int]:
    """Squares of all repeats about their means, and their degrees of freedom."""
    groups, squares = group_repeats(z, weight, cell)
    return float(squares.sum()), sum(rows.size - 1 for rows in groups)


def gross_groups(groups: Sequence[Integers], squares: Floats, is_stated: bool) -> Bools:
    """Which groups disagree grossly; none where more than a quarter do: then the scatter itself is uneven.

    Without a stated sd repeats that agree differ by the least difference that is seen: values are rounded.
    """
    freedom = np.array([rows.size - 1 for rows in groups])
    if not squares.any():
        return np.zeros(freedom.size, dtype=np.bool_)
    if not is_stated:
        squares = np.maximum(squares, np.min(squares, where=squares > 0.0, initial=np.inf))
    typical, is_gross = squares / special.chdtri(freedom, 0.5), np.zeros(freedom.size, dtype=np.bool_)
    for k, degrees in enumerate(freedom):
        others = np.repeat(np.delete(typical, k), np.delete(freedom, k))
        sharp, scale, chance = EFFICIENCY * others.size, float(np.median(others)) if others.size else 0.0, 1.0
        if is_stated:
            grid, share = sd_factor_distribution(scale * sharp, sharp)
            chance = float(share @ special.chdtrc(degrees, squares[k] * np.exp(-2.0 * grid)))
        elif sharp:
            rest = np.delete(squares, k).sum() / others.size  # few groups: their mean is sharper
            each = ((sharp, scale), (others.size, rest))
            chance = min(float(special.fdtrc(degrees, nu, squares[k] / degrees / size)) for nu, size in each)
        is_gross[k] = chance * freedom.size < GROSS
    return is_gross & (is_gross.sum() <= max(1, freedom.size // 4))


def sd_factor_distribution(squares: float, freedom: float) -> tuple[Floats, Floats]:
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


def rows_against_repeats(z: Floats, weights: Sequence[Floats], cell: Floats, with_sd: bool) -> Bools:
    """Rows that disagree grossly with their repeats, under every one of some weights; both rows of a pair."""
    off = np.zeros(z.size, dtype=np.bool_)
    while True:
        ways = [group_repeats(np.where(off, nan, z), weight, cell) for weight in weights]
        bad = np.all([gross_groups(*way, with_sd) for way in ways], axis=0)
        if not bad.any():
            return off
        for k in np.flatnonzero(bad):
            rows = ways[0][0][k]
            off[rows if rows.size == 2 else row_farthest_from_median(z, rows, rows)] = True


def row_farthest_from_median(z: Floats, rows: Integers, others: Integers) -> Integers:
    """The row farthest from the median of others; all where it lies less than twice as far as the nearest."""
    away = np.abs(z[rows] - np.median(z[others]))
    return rows[[np.argmax(away)]] if away.max() > 2.0 * away.min() else rows


def suspect_rows_of_group(z: Floats, rows: Integers, off: Bools, conditions: Sequence[Floats]) -> Integers:
    """Rows of a group to check; of a pair the one farthest from those of the nearest conditions, by ranks."""
    sound = np.flatnonzero(~off & np.isfinite(z))
    if not off[rows].all() or not sound.size:
        return rows[off[rows]]
    columns = [np.nan_to_num(column) for column in conditions]
    ranks = [np.searchsorted(np.sort(x), x) + np.searchsorted(np.sort(x), x, "right") for x in columns]
    far = np.sum([(rank[sound] - rank[rows[0]]) ** 2 for rank in ranks], axis=0) + np.zeros(sound.size)
    return row_farthest_from_median(z, rows, sound[np.argsort(far, kind="stable")[:NEAREST]])


def lack_of_fit_p_value(parts: Iterable[tuple[float, float, float, float]]) -> float:
    """Chance that repeats scatter as far as their means lie from a model; NaN where none differ.

    `parts`, by observable: SS - SS_in, n - p - nu_in, SS_pe and nu_pe; one F test for all of them together.
    """
    tested = [part for part in parts if min(part[1:]) > 1e-12]  # equal repeats tell no scatter
    if not tested:
        return nan
    squares, dof, error, repeats = np.sum(tested, axis=0)
    return float(special.fdtrc(dof, repeats, max(squares, 0.0) / dof / (error / repeats)))
