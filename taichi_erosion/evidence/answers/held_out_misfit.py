"""Misfit of the held-out rows: every hypothesis predicts them, and residuals, chi2 and p rest on one error.

    s_i^2 = V_i + g_i^T C g_i,    e_i = (z_i - m_i) / s_i,    chi2 per row = mean of e_i^2

with V the variance of the measured mean, of the declared tolerance and of the simulated mean, g the slopes
of a row along strengths, calibrated numbers and errors that rows share, and C the covariance in which the
visible rows leave these; errors of the model itself come with the calibrated hypothesis. The e_i are
correlated by C, and on one heap by its scatter; p is the chance of as large a sum with these correlations.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows, comparison_rows
from taichi_erosion.evidence.data.findings import HypothesisFit
from taichi_erosion.evidence.data.heap_correlation import correlated
from taichi_erosion.evidence.data.linear_algebra import projection
from taichi_erosion.evidence.data.problem import Bools, Floats, Problem
from taichi_erosion.evidence.inference.goodness_of_fit import (
    RowErrors,
    model_variance,
    quadratic_form_p,
    rows_table,
)
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion, projected_residual, slopes_of
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, bound_predictor
from taichi_erosion.evidence.models.condition_errors import condition_errors


@dataclass(frozen=True)
class HeldOutPrediction:
    """What one hypothesis, calibrated on the visible rows, says of the held-out ones."""

    held: PreparedProblem
    expansion: Expansion  # with the means of the held-out rows, shared errors at their best; NaN without one
    covariance: Floats  # (m, m), of these means: by calibration, shared errors and errors of the model


def held_out_problem(prepared: PreparedProblem) -> PreparedProblem | None:
    """The held-out rows; a missing variance is that of the visible rows of the same observable.

    None where the vault is empty.
    """
    problem = prepared.problem
    if problem.vault.rows.size == 0:
        return None
    rows, simulated = known_rows(prepared, problem)
    if rows.size == 0:
        return None
    predictor, total = bound_predictor(problem, rows), rows.variance + simulated
    errors = condition_errors(rows)
    held = replace(
        prepared, rows=rows, predictor=predictor, variance=total, levels=(), condition_errors=errors
    )
    if not prepared.levels:
        return held
    widths = {name: float(np.max(prepared.rows.shared[:, k])) for k, name in enumerate(prepared.levels)}
    return held.with_free_levels(widths)


def known_rows(prepared: PreparedProblem, problem: Problem) -> tuple[ComparisonRows, Floats]:
    """Held-out rows of known variance, and that of their simulated means."""
    rows = comparison_rows(problem, problem.hidden())
    typical = {each.name: chosen for each, chosen in prepared.by_observable()}
    variance, simulated = np.full(rows.size, np.nan), np.zeros(rows.size)
    for row, name in enumerate(rows.names):
        if name in typical:
            variance[row] = np.median(prepared.rows.variance[typical[name]])
            simulated[row] = np.median(prepared.seed_variance[typical[name]]) / prepared.seeds.scoring.size
    rows = correlated(replace(rows, variance=np.where(rows.known, rows.variance, variance)), prepared.heaps)
    return rows.rows(rows.known), simulated[rows.known]


def held_out_prediction(
    prepared: PreparedProblem, expansion: Expansion, held: PreparedProblem
) -> HeldOutPrediction:
    """Means of the held-out rows with their covariance, from the visible rows.

    Strengths have the width of their prior here, so that one that the visible rows leave open is not wider. A
    number at the end of its range stays there.
    """
    best, work = expansion.fit, prepared.working(expansion.mean)
    white = prepared.whitening(work)
    moving = ~projected_residual(prepared, expansion).stuck
    widths = [prepared.candidate(name, best.beyond).prior_scale for name in best.names]
    unit = np.concatenate([widths, np.ones(len(prepared.axes))]) * moving
    slopes = expansion.slopes * unit
    columns = white(expansion.shared)
    part, sizes = projection(white(slopes), columns), projection(columns[:, :0], columns)
    found = sizes.solve(np.concatenate([work.residual, np.zeros(expansion.shared.shape[1])]))
    there = slopes_of(held, best)
    count = len(prepared.axes)
    there = np.hstack([there[:, count:], there[:, :count]]) * unit
    shared, unseen = shared_columns(prepared, held, expansion.shared.shape[1])
    mean = held.predictor.mean(best.x, best.acting(), prepared.seeds.scoring) + shared @ found
    both, own = np.hstack([there, shared]), held.model_errors(best.x, best.acting())
    covariance = both @ part.covariance() @ both.T + unseen @ unseen.T + own @ own.T
    told = replace(
        expansion,
        mean=mean,
        shared=np.hstack([held.rows.shared, own]),
        jacobian=there[:, len(best.names) :],
        local=there[:, : len(best.names)],
    )
    return HeldOutPrediction(held, told, covariance)


def shared_columns(prepared: PreparedProblem, held: PreparedProblem, count: int) -> tuple[Floats, Floats]:
    """Slopes of held-out rows along the `count` shared errors of the visible rows, and along those of others.

    An instrument without a visible row has its declared error.
    """
    shared = np.zeros((held.rows.size, count))
    unseen = np.zeros((held.rows.size, len(held.rows.observables)))
    size = np.sqrt(np.sum(held.rows.shared**2, axis=1))
    visible = {observable.name: own for observable, own in prepared.by_observable()}
    for index, observable in enumerate(held.rows.observables):
        rows = held.rows.which == index
        own = visible.get(observable.name)
        columns = [] if own is None else np.flatnonzero(np.any(prepared.rows.shared[own] != 0.0, axis=0))
        if len(columns) == 1:
            shared[rows, columns[0]] = size[rows]
        else:
            unseen[rows, index] = size[rows]
    return shared, unseen


def with_held_out(best: HypothesisFit, told: HeldOutPrediction, chosen: Bools) -> HypothesisFit:
    """A hypothesis with its errors on some of the held-out rows: misfit and log score per row, rms, p."""
    held, mean = told.held, np.where(chosen, told.expansion.mean, told.held.rows.z)
    variance = held.variance + np.maximum(np.diag(told.covariance), 0.0)
    wide = replace(held, variance=variance, rows=replace(held.rows, covariance=None))
    work = wide.working(mean)
    calibrated = np.diag(told.covariance) - model_variance(held, told.expansion)
    errors = RowErrors(work.residual, np.zeros(mean.size), np.maximum(calibrated, 0.0), variance)
    table = rows_table(held, replace(told.expansion, mean=mean), errors).select(chosen)
    if not chosen.any():
        return replace(best, vault_rows=table)
    scale = work.weight / wide.sd
    covariance = told.covariance if held.rows.covariance is None else told.covariance + held.rows.covariance
    correlation = covariance * np.outer(scale, scale)
    np.fill_diagonal(correlation, 1.0)
    names, gap = np.array(table.observable), table.measured - table.predicted
    residual = work.residual[chosen]
    return replace(
        best,
        vault_chi2_per_row=float(np.mean(residual**2)),
        vault_rmse={str(name): float(np.sqrt(np.mean(gap[names == name] ** 2))) for name in np.unique(names)},
        vault_p=float(quadratic_form_p(float(residual @ residual), correlation[np.ix_(chosen, chosen)])),
        vault_log_score=log_score(wide, mean, chosen) / int(chosen.sum()),
        vault_rows=table,
    )


def log_score(wide: PreparedProblem, mean: Floats, chosen: Bools) -> float:
    """Sum over rows of the ln of the density, or of the probability of a censored one, that was predicted.

    Up to a constant per row, on the comparison scale.

    Reference: Gneiting & Raftery (2007), J. Am. Stat. Assoc. 102, 359.
    """
    rows = wide.rows.rows(chosen)
    part = replace(wide, rows=rows, variance=wide.variance[chosen])
    return -0.5 * part.working(mean[chosen]).deviance - float(np.sum(np.log(part.sd[~rows.censored])))


def on_common_rows(
    fits: Sequence[tuple[HypothesisFit, HeldOutPrediction | None] | None],
) -> list[HypothesisFit | None]:
    """All hypotheses with their errors on the held-out rows for which each of them has a value."""
    means = [each[1].expansion.mean for each in fits if each is not None and each[1] is not None]
    if not means:
        return [None if each is None else each[0] for each in fits]
    common = np.all(np.isfinite(means), axis=0)
    return [
        None if each is None else each[0] if each[1] is None else with_held_out(each[0], each[1], common)
        for each in fits
    ]
