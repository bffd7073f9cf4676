"""Whether an effect that is named acts with one strength under all conditions, or by another law.

With g the change of the rows per unit of strength about the best fit and a smooth function u of one
condition, a strength s (1 + u) changes them by g s u. The chance of as much of that as is left is

    P(|F^T r|^2),    F = g L,    L L^T = k(c; l)

with r the residual that neither calibration nor the effect removes. Where the strength would have to vary, it
is a power of the condition that the list does not have: s (c / c0)^q.

Reference: Rasmussen & Williams (2006), Gaussian processes for machine learning, section 4.2 (kernels k).
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import nan

import numpy as np

from taichi_erosion.evidence.data.findings import Estimate
from taichi_erosion.evidence.data.mechanism_findings import StrengthTrend
from taichi_erosion.evidence.data.problem import Floats, Mechanism
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.doses.dose_forms import power_form, typical
from taichi_erosion.evidence.inference.doses.dose_laws import (
    LawRows,
    estimate,
    fitted_form,
    law_part,
    rows_about,
    settled_form,
)
from taichi_erosion.evidence.inference.doses.dose_path import DosePath, dose_path, moved_path, usable
from taichi_erosion.evidence.inference.goodness_of_fit import structure_p
from taichi_erosion.evidence.inference.marginal_likelihood import projected_residual
from taichi_erosion.evidence.inference.model_discrepancy import condition_axes, low_rank, squared_distance
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.refit import FittedHypothesis

LENGTH = 2.0  # of the kernel, in sd of a condition


def strength_trend(prepared: PreparedProblem, named: FittedHypothesis) -> StrengthTrend | None:
    """The condition along which the strength of a named effect would have to vary; None where it need not."""
    chances = varying_p(prepared, named)
    if not chances:
        return None
    condition = min(chances, key=lambda name: chances[name])
    p = min(1.0, len(chances) * chances[condition])
    if not levels.fails(p):
        return None
    exponent, share = power_of(prepared, named, condition)
    return StrengthTrend(named.names[0], condition, p, exponent, share)


def nearest_trend(prepared: PreparedProblem, refits: Sequence[FittedHypothesis]) -> StrengthTrend | None:
    """The same of the listed effect that leaves least misfit, where that power takes most of it away."""
    singles = [item for item in refits if len(item.names) == 1 and item.usable]
    if not singles:
        return None
    trend = strength_trend(prepared, min(singles, key=lambda item: item.fit.misfit))
    return trend if trend is not None and trend.share > levels.EXPLAINED_SHARE else None


def varying_p(prepared: PreparedProblem, named: FittedHypothesis) -> dict[str, float]:
    """Chance of what one strength leaves along each condition; empty but for one effect that works."""
    if len(named.names) != 1 or not named.usable:
        return {}
    left = projected_residual(prepared, named.expansion)
    slope = named.expansion.local[:, :1] * left.white.scale[:, np.newaxis]
    acts, found = slope[:, 0] != 0.0, {}
    for name, values in condition_axes(prepared).items():
        if np.ptp(values[acts]) > 0.0 if acts.any() else False:
            factor = slope * low_rank(np.exp(-0.5 * squared_distance(values, LENGTH)))
            found[name] = structure_p(left, factor)
    return found


def power_of(
    prepared: PreparedProblem, named: FittedHypothesis, condition: str
) -> tuple[Estimate | None, float]:
    """Power of a condition by which the strength varies, and the share of the misfit that it takes away.

    None and NaN where the condition is not positive.
    """
    fit, column = named.fit, prepared.rows.conditions[condition]
    acts = named.expansion.local[:, 0] != 0.0
    if not np.all(np.isfinite(column)) or np.any(column[acts] <= 0.0):
        return None, nan
    positive = positive_column(column, named)
    form = power_form({condition: positive})
    rows = strength_rows(prepared, named, condition, fit.x, np.full(column.size, float(fit.psi[0])))
    if rows is None:
        return None, nan
    part = law_part(rows, np.ones(column.size, dtype=np.bool_))
    first = fitted_form(part, form, np.array([float(fit.psi[0]), 0.0]))
    found = settled_form(prepared, first, partial(strength_rows, prepared, named, condition))
    freedom = max(column.size - form.size, 1)
    variance = float(found.covariance[1, 1]) * max(1.0, found.misfit / freedom)
    return estimate(float(found.numbers[1]), variance, form, 1), 1.0 - found.misfit / fit.misfit


def strength_rows(
    prepared: PreparedProblem,
    named: FittedHypothesis,
    condition: str,
    x: Floats,
    dose: Floats,
    like: DosePath | None = None,
) -> LawRows | None:
    """Rows for laws of the strength, about calibrated numbers and strengths; None without values."""
    name = named.names[0]
    most = prepared.candidate(name, named.fit.beyond).maximum
    if like is None:
        path = dose_path(prepared, Mechanism(name, 0.0, most), x)
    else:
        path = moved_path(prepared, like, x)
    if not usable(path):
        return None
    rows = rows_about(prepared, path, dose, named.expansion.shared)
    positive = positive_column(prepared.rows.conditions[condition], named)
    return replace(rows, conditions=rows.conditions | {condition: positive})


def positive_column(column: Floats, named: FittedHypothesis) -> Floats:
    """A condition where a named effect acts, a typical value elsewhere."""
    acts = named.expansion.local[:, 0] != 0.0
    return np.where(acts, column, typical(column[acts]))
