"""Scatter of measurements: stated, measured by repeats, and the one checked against the other."""

from dataclasses import dataclass
from math import exp, log, nan, sqrt

import numpy as np
from scipy import optimize, special, stats

from taichi_erosion.evidence.data.problem import Bools, Floats
from taichi_erosion.evidence.data.repeats import disagreeing, factors, pure_error

LEAST_FREEDOM = 3  # degrees of freedom from which repeats alone are believed
UNEVEN = 0.01  # chance below which sample variances are taken to differ in truth
LEAST_VARIANCE = 1e-3  # of the typical one, that any sample variance is taken to be
SHAPE_GAIN = 1.0  # ln likelihood by which another way of the scatter must be better
LEAST_SHAPE = 0.5  # of the typical sd
LEAST_PRIOR, MOST_PRIOR = 4.0, 1e6  # of nu_0, degrees of freedom of the common level


@dataclass(frozen=True)
class ObservableNoise:
    """Noise budget of one observable on its comparison scale: medians over its rows."""

    lab: float  # standard error of a row
    simulator: float  # standard error of the model's mean
    shared: float
    numerical: float
    repeats: int  # degrees of freedom behind the laboratory's own scatter
    stated_factor: float  # scatter found between repeated rows over stated scatter; NaN without such rows
    p: float  # of a factor as far from 1 by chance; NaN without repeated rows


@dataclass(frozen=True)
class Scatter:
    """Variance of single repeats, row by row, on the comparison scale; NaN where it is unknown."""

    variance: Floats
    freedom: float  # degrees of freedom by which repeated rows check it
    own_freedom: float  # degrees of freedom of the sample variances that it is made of
    factor: float  # scatter between repeated rows over stated scatter; NaN without repeated rows
    p: float
    pure: tuple[float, float]  # squares between repeats over these variances, degrees of freedom
    off: Bools  # rows that disagree grossly with their repeats


def prior_freedom(excess: float) -> float:
    """Degrees of freedom nu_0 of the common level: trigamma(nu_0 / 2) = excess, from LEAST_PRIOR up."""
    low, high = 0.5 * LEAST_PRIOR, MOST_PRIOR
    wanted = min(max(excess, float(special.polygamma(1, high))), float(special.polygamma(1, low)))
    found = optimize.root_scalar(lambda y: float(special.polygamma(1, y)) - wanted, bracket=(low, high))
    return 2.0 * float(found.root)


def moderated(variance: Floats, freedom: Floats, shapes: Floats) -> tuple[Floats, float]:
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
    shape = likely_shape(variance, freedom, shapes) ** 2
    relative = np.maximum(
        variance / shape, LEAST_VARIANCE * float(np.median(positive / shape[variance > 0.0]))
    )
    pooled = float(np.sum(freedom * variance / shape) / np.sum(freedom))
    whole = float(np.sum(freedom))
    even = pooled * shape * whole / max(whole - 2.0, 1.0), whole
    if variance.size < 2 or uneven_p(relative, freedom) > UNEVEN:
        return even
    level = np.log(relative) - special.digamma(freedom / 2.0) + np.log(freedom / 2.0)
    spread = float(np.var(level, ddof=1))
    excess = spread - float(np.mean(special.polygamma(1, freedom / 2.0)))
    if excess <= 0.0:
        return even
    prior = prior_freedom(excess)
    total = prior + freedom
    common = np.exp(level.mean() + special.digamma(prior / 2.0) - log(prior / 2.0))
    mixed = (prior * common + freedom * relative) / total
    return shape * mixed * total / (total - 2.0), 2.0 * variance.size / spread


def likely_shape(variance: Floats, freedom: Floats, shapes: Floats) -> Floats:
    """Variation of the scatter over the rows: the first of the shapes (k, n) unless another is much likelier.

        ln L = -1/2 sum nu_i ln(s_0^2 h_i^2),    s_0^2 = sum nu_i s_i^2 / h_i^2 / sum nu_i

    No row is given less than LEAST_SHAPE of the typical sd: a value near zero has more than a relative error.
    """
    bounded = bounded_shapes(shapes)
    pooled = np.sum(freedom * variance / bounded**2, axis=1) / np.sum(freedom)
    fit = -0.5 * (np.sum(freedom) * np.log(pooled) + np.sum(freedom * np.log(bounded**2), axis=1))
    best = int(np.argmax(fit))
    return bounded[best if fit[best] > fit[0] + SHAPE_GAIN else 0]


def bounded_shapes(shapes: Floats) -> Floats:
    """Shapes (k, n) over their typical values, none below LEAST_SHAPE of it."""
    usual = np.median(shapes, axis=1, keepdims=True)
    return np.maximum(shapes / np.where(usual > 0.0, usual, 1.0), LEAST_SHAPE)


def uneven_p(variance: Floats, freedom: Floats) -> float:
    """Chance that sample variances of equal scatters differ as much.

    Reference: Bartlett (1937), Proc. R. Soc. A 160, 268.
    """
    total = float(np.sum(freedom))
    pooled = log(float(np.sum(freedom * variance)) / total)
    statistic = total * pooled - float(np.sum(freedom * np.log(variance)))
    correction = 1.0 + (float(np.sum(1.0 / freedom)) - 1.0 / total) / (3.0 * (variance.size - 1))
    return float(stats.chi2.sf(statistic / correction, variance.size - 1))


def measurement_scatter(z: Floats, sd: Floats, repeats: Floats, cell: Floats, shapes: Floats) -> Scatter:
    """Scatter of the rows of one observable.

    `cell` is equal for rows that repeat one another; `shapes` are the ways in which sd may vary over the
    rows, on the comparison scale, the likeliest first.
    """
    variance = np.where(sd > 0.0, sd, np.nan) ** 2
    sampled = np.isfinite(variance) & (repeats >= 2.0)
    own = 0.0
    if sampled.any():
        variance[sampled], own = moderated(variance[sampled], repeats[sampled] - 1.0, shapes[:, sampled])
    known = np.isfinite(variance)
    if known.any():
        off = disagreeing(z, [weight := repeats / variance], cell, True)
        squares, between = pure_error(np.where(off, nan, z), weight, cell)
        variance = np.where(known, variance, np.nanmedian(variance))
        return corrected_by_repeats(variance, squares, between, own, off)
    off = disagreeing(z, list(repeats / bounded_shapes(shapes) ** 2), cell, False)
    squares, freedom = pure_error(np.where(off, nan, z), repeats, cell)
    if freedom >= LEAST_FREEDOM and squares > 0.0:
        # the variance of the t distribution that a residual over the measured scatter has
        variance, own = np.full(z.size, squares / (freedom - 2.0)), float(freedom)
    return Scatter(variance, 0.0, own, nan, nan, (max(own - 2.0, 0.0), own), off)


def corrected_by_repeats(variance: Floats, squares: float, between: int, own: float, off: Bools) -> Scatter:
    """Stated variances, scaled by the scatter of repeated rows: SS_pe ~ chi^2(nu) if they are right."""
    if between == 0:
        return Scatter(variance, 0.0, own, nan, nan, (0.0, 0.0), off)
    factor = sqrt(squares / between)
    tail = float(stats.chi2.sf(squares, between))
    grid, share = factors(squares, between)
    scale = exp(2.0 * float(share @ grid))  # of exp E[ln f]
    p, pure = min(1.0, 2.0 * min(tail, 1.0 - tail)), (squares / scale, float(between))
    return Scatter(variance * scale, float(between), own, factor, p, pure, off)


def unchecked_noise_sentence(freedom: float) -> str:
    """Advice where the noise level is only stated; empty where repeats check it."""
    if freedom >= LEAST_FREEDOM:
        return ""
    return (
        "The stated sd cannot be checked: no condition was repeated. At least 3 repeats at 4 or more "
        "conditions would separate noise from a missing effect."
    )
