"""Scatter of the laboratory: stated, measured by repeats, and checked one against the other."""

from dataclasses import dataclass
from math import log, sqrt

import numpy as np
from scipy import special, stats

from taichi_erosion.evidence.algebra import log_sum_exp
from taichi_erosion.evidence.problem import Floats

RIGHT_SHARE = 0.8  # of stated sd that are right [1]
RIGHT_SD = 0.05  # of ln(true / stated sd) where it is right
WRONG_MEAN, WRONG_SD = 0.2, 0.4  # of ln(true / stated sd) where it is not
LEAST_FREEDOM = 3  # degrees of freedom from which repeats alone are believed
TREND_ROWS = 8  # rows from which a trend of the scatter with the value is looked for
TREND_P = 0.01  # significance that such a trend must have
DOUBT = 0.2  # mean of ln(true sd / stated sd) where nothing checks it: exponential above 1


@dataclass(frozen=True)
class Scatter:
    """Variance of single repeats, row by row, on the comparison scale; NaN where nothing tells it."""

    variance: Floats
    freedom: float  # degrees of freedom behind it
    factor: float  # scatter between repeated rows over stated scatter; NaN without repeated rows
    p: float


def trigamma_inverse(value: float) -> float:
    """Y with trigamma(y) = value, by Newton steps on 1 / trigamma.

    Reference: Smyth (2004), Stat. Appl. Genet. Mol. Biol. 3(1), 3, appendix.
    """
    if value > 1e7:
        return 1.0 / sqrt(value)
    if value < 1e-6:
        return 1.0 / value
    y = 0.5 + 1.0 / value
    for _ in range(50):
        trigamma = float(special.polygamma(1, y))
        change = trigamma * (1.0 - trigamma / value) / float(special.polygamma(2, y))
        y += change
        if abs(change) < 1e-9 * y:
            break
    return y


def moderated(variance: Floats, freedom: Floats, size: Floats) -> Floats:
    """Sample variances of few repeats, drawn towards their common level (or trend with the value's size).

        s~_i^2 = (nu_0 s_0i^2 + nu_i s_i^2) / (nu_0 + nu_i)

    with nu_0 and s_0 estimated from the spread of all s_i^2: three repeats give an sd that is wrong by half,
    and weights made of it give false alarms.

    Reference: Smyth (2004), Stat. Appl. Genet. Mol. Biol. 3(1), 3, section 6.2.
    """
    positive = variance[variance > 0.0]
    if positive.size == 0:
        return np.full(variance.size, np.nan)
    floored = np.maximum(variance, 1e-3 * float(np.median(positive)))
    level = np.log(floored) - special.digamma(freedom / 2.0) + np.log(freedom / 2.0)
    centre = np.full(level.size, level.mean())
    used = 1
    if level.size >= TREND_ROWS and np.ptp(size) > 0.0:
        if np.asarray(stats.pearsonr(size, level))[1] < TREND_P:
            centre, used = np.polyval(np.polyfit(size, level, 1), size), 2
    if level.size <= used:
        return floored
    excess = np.sum((level - centre) ** 2) / (level.size - used) - float(
        np.mean(special.polygamma(1, freedom / 2.0))
    )
    if excess <= 0.0:
        return np.exp(centre)
    prior = 2.0 * trigamma_inverse(float(excess))
    common = np.exp(centre + special.digamma(prior / 2.0) - log(prior / 2.0))
    return (prior * common + freedom * floored) / (prior + freedom)


def lab_scatter(scaled: Floats, sd: Floats, repeats: Floats, cell: Floats) -> Scatter:
    """Scatter of the rows of one observable; `cell` numbers the conditions, equal for repeated rows."""
    variance = np.where(sd > 0.0, sd, np.nan) ** 2
    sampled = np.isfinite(variance) & (repeats >= 2.0)
    freedom = float(np.sum(repeats[sampled] - 1.0))
    if sampled.any():
        size = np.log(np.abs(scaled[sampled]) + 1e-300)
        variance[sampled] = moderated(variance[sampled], repeats[sampled] - 1.0, size)
    squares, between = between_repeats(scaled, variance, repeats, cell)
    if np.isfinite(variance).any():
        variance = np.where(np.isfinite(variance), variance, np.nanmedian(variance))
        return checked(variance, squares, between, freedom)
    raw, raw_freedom = between_repeats(scaled, np.ones(scaled.size), repeats, cell)
    if raw_freedom >= LEAST_FREEDOM and raw > 0.0:
        variance = np.full(scaled.size, raw / raw_freedom)
        freedom += raw_freedom
    return Scatter(variance, freedom, np.nan, np.nan)


def between_repeats(scaled: Floats, variance: Floats, repeats: Floats, cell: Floats) -> tuple[float, int]:
    """Weighted sum of squares of repeated rows about their means, and its degrees of freedom."""
    total, freedom = 0.0, 0
    good = np.isfinite(variance) & np.isfinite(scaled)
    for number in np.unique(cell[good]):
        rows = good & (cell == number)
        if rows.sum() > 1:
            weight = repeats[rows] / variance[rows]
            mean = np.average(scaled[rows], weights=weight)
            total += float(np.sum(weight * (scaled[rows] - mean) ** 2))
            freedom += int(rows.sum()) - 1
    return total, freedom


def checked(variance: Floats, squares: float, between: int, freedom: float) -> Scatter:
    """Stated variances, scaled by what repeated rows say of them: SS_pe ~ chi^2(nu) if they are right."""
    if between == 0:
        return Scatter(variance, freedom, np.nan, np.nan)
    factor = sqrt(squares / between)
    tail = float(stats.chi2.sf(squares, between))
    scale = likely_factor(squares, between) ** 2
    return Scatter(variance * scale, freedom + between, factor, min(1.0, 2.0 * min(tail, 1.0 - tail)))


def likely_factor(squares: float, between: int) -> float:
    """True over stated sd, given the scatter between repeated rows: exp E[ln f].

    Most statements are right to a few percent, some are wrong by a factor (an instrument's error given for
    the scatter of samples, a standard error for an sd); the mixture keeps eight repeats from overruling a
    good statement by their own chance, and lets them overrule a bad one.
    """
    grid = np.linspace(-1.2, 1.6, 281)  # ln f
    right = log(RIGHT_SHARE / RIGHT_SD) - 0.5 * (grid / RIGHT_SD) ** 2
    wrong = log((1.0 - RIGHT_SHARE) / WRONG_SD) - 0.5 * ((grid - WRONG_MEAN) / WRONG_SD) ** 2
    weight = np.logaddexp(right, wrong) - between * grid - 0.5 * squares * np.exp(-2.0 * grid)
    weight = np.exp(weight - weight.max())
    return float(np.exp(np.sum(weight * grid) / weight.sum()))


@dataclass(frozen=True)
class Doubt:
    """Prior of the factor by which every stated sd may be wrong: a grid and its log weights."""

    factor: Floats
    log_weight: Floats


def noise_doubt(freedom: float) -> Doubt:
    """How far the noise level may be wrong, given the degrees of freedom that measure it.

    Without repeats a stated sd can only be understated: ln f ~ exponential with mean DOUBT. With nu degrees
    of freedom ln f ~ N(0, 1 / (2 nu)), never wider than DOUBT.
    """
    if freedom < LEAST_FREEDOM:
        grid = np.linspace(0.0, 6.0 * DOUBT, 10)
        log_weight = -grid / DOUBT
        log_weight[0] -= log(2.0)  # half a cell at the end of the grid
    else:
        sd = min(DOUBT, sqrt(0.5 / freedom))
        grid = sd * np.linspace(-3.0, 3.0, 9)
        log_weight = -0.5 * (grid / sd) ** 2
    return Doubt(np.exp(grid), log_weight - log_sum_exp(log_weight))


def doubt_sentence(freedom: float) -> str:
    """What to measure when the noise level is only asserted."""
    if freedom >= LEAST_FREEDOM:
        return ""
    return (
        "The stated sd cannot be checked: no condition was repeated. At least 3 repeats at 4 or more "
        "conditions would separate noise from a missing effect."
    )
