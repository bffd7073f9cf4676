"""Effects of a screening whose centre shows how far the response is from a plane.

Centre points and corners have means of their own, so that a bent response is neither taken for noise nor for
an effect: effects follow from the corners, the error from what is left there and from the centre's runs.

Reference: Montgomery (2017), Design and Analysis of Experiments, 9th ed., 6.8.
"""

from dataclasses import replace
from math import nan

import numpy as np
from scipy import stats

from taichi_erosion.experiments.anova import Curvature, curvature
from taichi_erosion.experiments.effects import CONFIDENCE, Effect, EffectLimits, effect_limits, effects
from taichi_erosion.experiments.fit import Fit
from taichi_erosion.experiments.table import SAME_POINT, Floats


def screened_effects(fit: Fit) -> tuple[list[Effect], EffectLimits]:
    """Effects in the order of the terms, and their limits; without centre points those of the plain model."""
    corners, bent = corner_fit(fit), curvature(fit)
    if corners is None or bent is None:
        return effects(fit), effect_limits(fit)
    spread = corner_errors(corners, bent)
    found = [judged(one, error, bent.df_error) for one, error in zip(effects(corners), spread, strict=True)]
    tail, largest = 0.5 * (1.0 - CONFIDENCE), float(spread.max())
    limits = EffectLimits(
        single=float(stats.t.isf(tail, bent.df_error)) * largest,
        bonferroni=float(stats.t.isf(tail / len(found), bent.df_error)) * largest,
        lenth_margin=nan,
        lenth_simultaneous=nan,
    )
    return found, limits


def corner_fit(fit: Fit) -> Fit | None:
    """The same model on the corners alone; None without a centre, or where too few corners have a result."""
    corner = np.any(np.abs(fit.coded) > SAME_POINT, axis=1)
    part = replace(
        fit,
        coded=fit.coded[corner],
        values=fit.values[corner],
        blocks=fit.blocks[corner],
        rows=fit.rows[corner],
    )
    coefficients = len(fit.terms) + len(np.unique(fit.blocks))
    carried = np.linalg.matrix_rank(part.results.model.exog) == coefficients
    return part if carried and not corner.all() else None


def corner_errors(corners: Fit, bent: Curvature) -> Floats:
    """Standard error of every effect, in the response's unit."""
    return 2.0 * np.sqrt(bent.ms_error * np.diag(corners.unscaled_covariance)[1:])


def judged(effect: Effect, error: float, df: int) -> Effect:
    """The effect with t and p for a standard error."""
    t = effect.value / float(error) if error > 0.0 else nan
    return replace(effect, t=t, p=2.0 * float(stats.t.sf(abs(t), df)))
