"""Misfit of the held-out rows: every hypothesis predicts them, and residuals, chi2 and p rest on one error.

    s_i^2 = V_i + g_i^T C g_i,    e_i = (z_i - m_i) / s_i,    chi2 per row = mean of e_i^2

with V the variance of the measured mean, of the declared tolerance and of the simulated mean, g the slopes
of a row along strengths, calibrated numbers and errors that rows share, and C the covariance in which the
visible rows leave these; errors of the model itself come with the calibrated hypothesis. The e_i are
correlated by C, and on one heap by its scatter; p is the chance of as large a sum with these correlations.

A source that states no scatter, while others do, has f^2 times the V that its rows would get from others:

    p(f | rows) = p(f) sum_h p(visible rows of it | h, f) N(z - m_h; 0, f^2 V + G C G^T),    f^-2 -> E[f^-2]

over all hypotheses h that are compared, so that all have the same errors, with ln f uniform over SCATTERS.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows, comparison_rows
from taichi_erosion.evidence.data.findings import HypothesisFit
from taichi_erosion.evidence.data.heap_correlation import correlated
from taichi_erosion.evidence.data.linear_algebra import log_sum_exp, projection
from taichi_erosion.evidence.data.number_words import counted
from taichi_erosion.evidence.data.problem import Bools, Floats, Problem
from taichi_erosion.evidence.inference.goodness_of_fit import (
    RowErrors,
    model_variance,
    quadratic_form_p,
    rows_table,
)
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion, projected_residual, slopes_of
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, bound_predictor
from taichi_erosion.evidence.inference.robustness.error_accounts import UNSTATED, with_scatter
from taichi_erosion.evidence.inference.robustness.error_findings import observable_of, size_words
from taichi_erosion.evidence.inference.robustness.linear_steps import linear_evidence
from taichi_erosion.evidence.models.condition_errors import condition_errors

SCATTERS = np.geomspace(UNSTATED[0], UNSTATED[-1], 29)  # sd of a source that states none over that of others


@dataclass(frozen=True)
class HeldOutPrediction:
    """What one hypothesis, calibrated on the visible rows, says of the held-out ones."""

    held: PreparedProblem
    expansion: Expansion  # with the means of the held-out rows, shared errors at their best; NaN without one
    fitted: Expansion  # of the visible rows
    covariance: Floats  # (m, m), of these means: by calibration, shared errors and errors of the model


PredictedFit = tuple[HypothesisFit, HeldOutPrediction | None]  # None: no row is held out


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
    return HeldOutPrediction(held, told, expansion, covariance)


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


@dataclass(frozen=True)
class SilentSource:
    """A source that states no scatter of an observable, while others do."""

    observable: str
    source: str
    held: Bools  # (m,), its held-out rows
    visible: Bools  # (n,), its visible rows


def silent_sources(prepared: PreparedProblem, held: PreparedProblem) -> Iterator[SilentSource]:
    """Every such source among the held-out rows."""
    there, here = np.array(held.rows.source_names), np.array(prepared.rows.source_names)
    known = {each.name: own for each, own in prepared.by_observable()}
    for observable, chosen in held.by_observable():
        own = known.get(observable.name)
        for source in np.unique(there[chosen]) if own is not None else ():
            rows, visible = chosen & (there == source), own & (here == source)
            stated = np.any(held.rows.stated[rows]) or np.any(prepared.rows.stated[visible])
            if not stated and np.any(prepared.rows.stated[own]):
                yield SilentSource(observable.name, str(source), rows, visible)


def with_silent_sources(
    prepared: PreparedProblem, fits: Sequence[PredictedFit | None]
) -> tuple[list[PredictedFit | None], list[str]]:
    """All hypotheses with the scatter of held-out sources that state none, and sentences about it."""
    told = [fit[1] for fit in fits if fit and fit[1]]
    if not told:
        return list(fits), []
    held, sentences = silent_scatter(prepared, told)
    return [fit and (fit[0], fit[1] and replace(fit[1], held=held)) for fit in fits], sentences


def silent_scatter(
    prepared: PreparedProblem, told: Sequence[HeldOutPrediction]
) -> tuple[PreparedProblem, list[str]]:
    """The held-out rows with the scatter of sources that state none, by what hypotheses say of them.

    Comes with a sentence about each of these sources.
    """
    held, sentences, size = told[0].held, list[str](), np.ones(told[0].held.rows.size)
    for each in silent_sources(prepared, held):
        table = np.array([scatter_evidence(prepared, one, each) for one in told])
        weight = np.exp(log_sum_exp(table, axis=0) - log_sum_exp(table))
        size[each.held] = 1.0 / float(weight @ SCATTERS**-2.0)
        sentences.append(silent_words(prepared, held, each, float(np.sqrt(size[each.held][0]))))
    return held.with_rows(held.rows.rescattered(size)), sentences


def scatter_evidence(prepared: PreparedProblem, told: HeldOutPrediction, silent: SilentSource) -> Floats:
    """Ln likelihood of every size of SCATTERS under one hypothesis, of visible and held-out rows."""
    held, mean = told.held, told.expansion.mean
    rows = np.flatnonzero(silent.held & ~held.rows.censored & np.isfinite(mean))
    at, gap = np.ix_(rows, rows), (held.rows.z - mean)[rows]
    scatter = np.diag(held.rows.variance[rows])
    if held.rows.covariance is not None:
        scatter = scatter + held.rows.covariance[at]
    rest = told.covariance[at] + np.diag((held.variance - held.rows.variance)[rows])
    found = []
    for factor in SCATTERS:
        sizes = np.where(silent.visible, factor**2, 1.0)
        seen = linear_evidence(with_scatter(prepared, sizes), told.fitted) if silent.visible.any() else 0.0
        covariance = factor**2 * scatter + rest
        volume = float(np.linalg.slogdet(covariance)[1])
        found.append(seen - 0.5 * (volume + float(gap @ np.linalg.solve(covariance, gap))))
    return np.array(found)


def silent_words(
    prepared: PreparedProblem, held: PreparedProblem, silent: SilentSource, factor: float
) -> str:
    """What the held-out rows of such a source count with, and what they can show."""
    observable, unit = observable_of(prepared, silent.observable)
    size = size_words(observable, unit, factor * float(np.sqrt(np.median(held.rows.variance[silent.held]))))
    count = int(silent.held.sum())
    words = f"{silent.observable}: {silent.source} states no scatter; its {counted(count, 'held-out row')} "
    words += (
        f"{'counts' if count == 1 else 'count'} with {size}, {factor:.2g} times what the others suggest, "
    )
    if silent.visible.any():
        return f"{words}estimated from its fitted and held-out rows."
    return f"{words}estimated from these rows: they compare models, and cannot show that one is adequate."


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


def on_common_rows(fits: Sequence[PredictedFit | None]) -> list[HypothesisFit | None]:
    """All hypotheses with their errors on the held-out rows for which each of them has a value."""
    means = [each[1].expansion.mean for each in fits if each is not None and each[1] is not None]
    if not means:
        return [None if each is None else each[0] for each in fits]
    common = np.all(np.isfinite(means), axis=0)
    return [
        None if each is None else each[0] if each[1] is None else with_held_out(each[0], each[1], common)
        for each in fits
    ]
