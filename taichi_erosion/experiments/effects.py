"""Effects of a two-level design, and how large one must be to be believed.

    effect = mean at high - mean at low = 2 b
    t limit            t(0.975, df)
    Bonferroni limit   t(1 - 0.025 / m, df)  for m effects
    Lenth: s_0 = 1.5 median |effect|,  PSE = 1.5 median of those |effect| < 2.5 s_0,
           ME = t(0.975, m / 3) PSE,  SME = t((1 + 0.95^(1/m)) / 2, m / 3) PSE

Lenth's limits need no error of their own and serve a saturated design.

References: Montgomery (2017), ch. 6; Lenth (1989), Technometrics 31, 469, eq. (1)-(4).
"""

from dataclasses import dataclass
from math import nan

import numpy as np
from scipy import stats

from taichi_erosion.experiments.anova import term_sums
from taichi_erosion.experiments.design_table import Floats
from taichi_erosion.experiments.fit import Fit

CONFIDENCE = 0.95  # [1]
LENTH_INFLATION, LENTH_TRIM = 1.5, 2.5  # Lenth (1989): 1.5 makes the median of |N(0, s)| an estimate of s [1]


@dataclass(frozen=True)
class Effect:
    """One effect, in the response's unit."""

    name: str
    value: float
    share: float  # of the sum of squares of all terms [1]
    t: float
    p: float


@dataclass(frozen=True)
class EffectLimits:
    """Sizes of an effect beyond which it is believed, in the response's unit; NaN where none can be given."""

    single: float  # t limit
    bonferroni: float
    lenth_margin: float  # ME
    lenth_simultaneous: float  # SME


def effects(fit: Fit) -> list[Effect]:
    """Effects of a linear or interaction model, in the order of its terms."""
    sums = term_sums(fit)
    spread = effect_errors(fit)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = 2.0 * fit.coefficients[1:] / spread
    p = 2.0 * stats.t.sf(np.abs(t), fit.df_error)
    return [
        Effect(name, 2.0 * float(b), float(ss / sums.sum()) if sums.sum() else nan, float(t_k), float(p_k))
        for name, b, ss, t_k, p_k in zip(fit.names, fit.coefficients[1:], sums, t, p, strict=True)
    ]


def effect_errors(fit: Fit) -> Floats:
    """Standard error of every effect, in the response's unit."""
    return 2.0 * np.sqrt(fit.ms_error * np.diag(fit.unscaled_covariance)[1:])


def effect_limits(fit: Fit) -> EffectLimits:
    """Limits for the effects of a fit; the t limits hold for the least certain of them."""
    count, df = len(fit.terms), fit.df_error
    spread = float(effect_errors(fit).max()) if df else nan
    tail = 0.5 * (1.0 - CONFIDENCE)
    margin, simultaneous = lenth_limits(2.0 * fit.coefficients[1:])
    return EffectLimits(
        single=float(stats.t.isf(tail, df)) * spread if df else nan,
        bonferroni=float(stats.t.isf(tail / count, df)) * spread if df else nan,
        lenth_margin=margin,
        lenth_simultaneous=simultaneous,
    )


def lenth_limits(values: Floats) -> tuple[float, float]:
    """Lenth's margin of error, for one effect and for all at once; for effects of one standard error."""
    sizes = np.abs(values)
    first = LENTH_INFLATION * float(np.median(sizes))
    small = sizes[sizes < LENTH_TRIM * first]
    if not len(small):
        return nan, nan
    pseudo_error, df = LENTH_INFLATION * float(np.median(small)), len(sizes) / 3.0
    together = 0.5 * (1.0 + CONFIDENCE ** (1.0 / len(sizes)))
    single = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, df))
    return single * pseudo_error, float(stats.t.ppf(together, df)) * pseudo_error


def half_normal_scores(count: int) -> Floats:
    """Expected sizes of `count` sorted pure-noise effects, in standard errors: (i - 1/2) / n quantiles."""
    return np.asarray(stats.norm.ppf(0.5 + 0.5 * (np.arange(1, count + 1) - 0.5) / count))
