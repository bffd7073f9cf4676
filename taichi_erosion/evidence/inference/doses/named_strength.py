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
from math import nan

import numpy as np

from taichi_erosion.evidence.data.findings import Estimate
from taichi_erosion.evidence.data.mechanism_findings import StrengthTrend
from taichi_erosion.evidence.data.problem import Floats, Mechanism
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.cross_validation import fold_numbers
from taichi_erosion.evidence.inference.doses.dose_forms import power_form, typical
from taichi_erosion.evidence.inference.doses.dose_inference import ridge
from taichi_erosion.evidence.inference.doses.dose_laws import FOLDS, LawRows, estimate, fitted_form
from taichi_erosion.evidence.inference.doses.dose_path import dose_path
from taichi_erosion.evidence.inference.goodness_of_fit import structure_p
from taichi_erosion.evidence.inference.marginal_likelihood import projected_residual
from taichi_erosion.evidence.inference.model_discrepancy import condition_axes, low_rank, squared_distance
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.refit import FittedHypothesis

LENGTH = 2.0  # of the kernel, in sd of a condition
ROUNDS = 6  # in which the law is fitted anew where the calibrated numbers have moved
STILL = 0.02  # move below which they stay, in prior sd


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
    slope = (named.expansion.local[:, 0] * left.scale)[:, np.newaxis]
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
    positive = np.where(acts, column, typical(column[acts]))
    form, everything = power_form({condition: positive}), np.ones(column.size, dtype=np.bool_)
    numbers, x, found = np.array([float(fit.psi[0]), 0.0]), fit.x, None
    for _ in range(ROUNDS):
        dose = form.dose({condition: positive}, numbers)
        rows = strength_rows(prepared, named, x, dose)
        if rows is None:
            break
        rows = replace(rows, conditions=rows.conditions | {condition: positive})
        found = fitted_form(rows, form, everything, numbers)
        numbers = found.numbers
        at = ridge(rows.columns, rows.residual(form.dose({condition: positive}, numbers)))[: x.size]
        moved, x = np.max(np.abs(at - x), initial=0.0), np.clip(at, prepared.low, prepared.high)
        if moved < STILL:
            break
    if found is None:
        return None, nan
    freedom = max(column.size - form.size, 1)
    variance = float(found.covariance[1, 1]) * max(1.0, found.misfit / freedom)
    return estimate(float(numbers[1]), variance, form, 1), 1.0 - found.misfit / fit.misfit


def strength_rows(
    prepared: PreparedProblem, named: FittedHypothesis, x: Floats, dose: Floats
) -> LawRows | None:
    """Rows for laws of the strength, about calibrated numbers and strengths; None without values."""
    name, shared = named.names[0], named.expansion.shared
    most = prepared.candidate(name, named.fit.beyond).maximum
    path = dose_path(prepared, Mechanism(name, 0.0, most), x)
    if path.curve is None or not np.all(np.isfinite(path.bare)):
        return None
    change, jacobian = path.change(dose)[0], path.slopes(dose)[0]
    work = prepared.working(path.bare + change)
    scale = work.weight / prepared.sd
    columns = np.hstack([jacobian, shared]) * scale[:, np.newaxis]
    start = np.concatenate([x, np.zeros(shared.shape[1])])
    target = work.residual + columns @ start + scale * change
    return LawRows(path, prepared.rows.conditions, target, scale, columns, fold_numbers(prepared) % FOLDS)
