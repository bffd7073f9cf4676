"""Whether an effect that is named acts with one strength under all conditions, or by another law.

With g the change of the rows per unit of strength about the best fit and a smooth function u of one
condition, a strength s (1 + u) changes them by g s u. The chance of as much of that as is left is

    P(|F^T r|^2),    F = g L,    L L^T = k(c; l)

with r the residual that neither calibration nor the effect removes. Where the strength would have to vary, it
is a power of the condition that the list does not have: s (c / c0)^q.

Reference: Rasmussen & Williams (2006), Gaussian processes for machine learning, section 4.2 (kernels k).
"""

from dataclasses import replace

import numpy as np

from taichi_erosion.evidence.data.findings import Estimate
from taichi_erosion.evidence.data.mechanism_findings import StrengthTrend
from taichi_erosion.evidence.data.problem import Floats, Mechanism
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.cross_validation import fold_numbers
from taichi_erosion.evidence.inference.doses.dose_forms import power_form, typical
from taichi_erosion.evidence.inference.doses.dose_laws import FOLDS, LawRows, estimate, fitted_form
from taichi_erosion.evidence.inference.doses.dose_path import dose_path
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
    return StrengthTrend(named.names[0], condition, p, power_of(prepared, named, condition))


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


def power_of(prepared: PreparedProblem, named: FittedHypothesis, condition: str) -> Estimate | None:
    """Power of a condition by which the strength varies; None where the condition is not positive."""
    fit, column = named.fit, prepared.rows.conditions[condition]
    acts = named.expansion.local[:, 0] != 0.0
    if not np.all(np.isfinite(column)) or np.any(column[acts] <= 0.0):
        return None
    most = prepared.candidate(fit.names[0], fit.beyond).maximum
    rows = strength_rows(prepared, named, Mechanism(fit.names[0], 0.0, most))
    if rows is None:
        return None
    positive = np.where(acts, column, typical(column[acts]))
    rows = replace(rows, conditions=rows.conditions | {condition: positive})
    form, everything = power_form({condition: positive}), np.ones(column.size, dtype=np.bool_)
    found = fitted_form(rows, form, everything, np.array([float(fit.psi[0]), 0.0]))
    excess = max(1.0, found.misfit / max(column.size - form.size, 1))
    return estimate(float(found.numbers[1]), float(found.covariance[1, 1]) * excess, form, 1)


def strength_rows(prepared: PreparedProblem, named: FittedHypothesis, path_of: Mechanism) -> LawRows | None:
    """Rows for laws of the strength, about the best fit."""
    fit, expansion = named.fit, named.expansion
    path = dose_path(prepared, path_of, fit.x)
    if path.curve is None or not np.all(np.isfinite(path.bare)):
        return None
    change, _ = path.change(np.full(prepared.rows.size, float(fit.psi[0])))
    jacobian, _ = path.slopes(np.full(prepared.rows.size, float(fit.psi[0])))
    work = prepared.working(path.bare + change)
    scale = work.weight / prepared.sd
    columns = np.hstack([jacobian, expansion.shared]) * scale[:, np.newaxis]
    start = np.concatenate([fit.x, np.zeros(expansion.shared.shape[1])])
    target: Floats = work.residual + columns @ start + scale * change
    return LawRows(path, prepared.rows.conditions, target, scale, columns, fold_numbers(prepared) % FOLDS)
