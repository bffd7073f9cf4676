"""Does the model, calibrated as well as it can be, agree with the measurements, and where does it not?"""

from dataclasses import replace
from math import nan
from time import perf_counter

import numpy as np

from taichi_erosion.evidence.data.comparison_rows import tested_by_repeats
from taichi_erosion.evidence.data.findings import Comparison
from taichi_erosion.evidence.data.measurement_noise import unchecked_noise_sentence
from taichi_erosion.evidence.data.problem import Floats, Measurements, Observable, Problem, Progress
from taichi_erosion.evidence.data.repeats import JOINT, LackOfFit
from taichi_erosion.evidence.data.transforms import slope, to_scale
from taichi_erosion.evidence.inference import goodness_of_fit, marginal_likelihood
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.intervals.estimates import correlations, estimates_alone
from taichi_erosion.evidence.inference.map_fit import fit_base, fit_free_levels
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion, ScoredHypothesis
from taichi_erosion.evidence.inference.pipeline import enough_for_levels, level_share
from taichi_erosion.evidence.inference.posterior import level_shifts
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, prepare

SEED = 1  # of the runs where a study states none; any other would do
GUESS_ROUNDS = 2  # calibrations from which a missing sd is guessed


def no_progress(_: str, __: float) -> None:
    """Progress that is not shown."""


def compare(problem: Problem, progress: Progress = no_progress, seed: int = SEED) -> Comparison:
    """Misfit per observable and along every condition; with unknown noise only its shape, not its size."""
    start = perf_counter()
    prepared, base, known = calibrated_base(problem, seed, progress)
    freed = levels_freed(prepared, base) if known else None
    placed = (prepared, base) if freed is None else freed
    p_free = nan if freed is None else goodness_of_fit.misfit_p(placed[0], placed[1].expansion)
    table = goodness_of_fit.rows_table(prepared, base.expansion)
    misfits = goodness_of_fit.observable_misfits(prepared, base.expansion, table)
    chi2 = goodness_of_fit.chi_square(prepared, base.expansion) if known else nan
    if not known:
        misfits = {name: replace(misfit, chi2=nan, p=nan) for name, misfit in misfits.items()}
    return Comparison(
        observables=misfits,
        where=goodness_of_fit.misfit_places(placed[0], placed[1].expansion),
        chi2=chi2,
        chi2_per_row=chi2 / max(prepared.rows.size, 1),
        dof=goodness_of_fit.freedom(marginal_likelihood.projected_residual(prepared, base.expansion)),
        p=goodness_of_fit.misfit_p(prepared, base.expansion) if known else nan,
        noise=goodness_of_fit.noise_table(prepared, known=known),
        parameters=estimates_alone(prepared, base)[1],
        correlations=correlations(prepared, base.expansion),
        rows=table,
        failures=prepared.predictor.cost.failures,
        warnings=prepared.warnings,
        runs=prepared.predictor.cost.runs,
        wall_s=perf_counter() - start,
        levels=() if levels.fails(p_free) else level_shifts(*placed),
        p_levels_free=p_free,
        stuck=tuple(goodness_of_fit.stuck_numbers(prepared, base.expansion)) if known else (),
        worst_row=goodness_of_fit.worst_row(prepared, base.expansion) if known else None,
        scatter_factor=possible_scatter(prepared, base.expansion) if known else nan,
        lack_of_fit=lack_of_fit(prepared, base.expansion),
    )


def lack_of_fit(prepared: PreparedProblem, expansion: Expansion) -> dict[str, LackOfFit]:
    """Tests of a calibrated model against the scatter between repeats."""
    left = marginal_likelihood.projected_residual(prepared, expansion)
    residual, leverage = left.white.unmixed(left.whole), np.sum(left.row_basis**2, axis=1)
    return tested_by_repeats(prepared.rows, prepared.variance, residual, leverage)


def possible_scatter(prepared: PreparedProblem, expansion: Expansion) -> float:
    """True over stated sd that would make the misfit chance; NaN where repeats contradict it."""
    joint = lack_of_fit(prepared, expansion).get(JOINT)
    contradicted = joint is not None and levels.fails(joint.p)
    return nan if contradicted else goodness_of_fit.scatter_factor(prepared, expansion)


def levels_freed(
    prepared: PreparedProblem, base: ScoredHypothesis
) -> tuple[PreparedProblem, ScoredHypothesis] | None:
    """The bare model with the level of every observable free, where it fails and this fits better."""
    places = goodness_of_fit.misfit_places(prepared, base.expansion)
    chances = (goodness_of_fit.misfit_p(prepared, base.expansion), *(place.p for place in places))
    if not any(map(levels.fails, chances)) or not enough_for_levels(prepared):
        return None
    free, best = fit_free_levels(prepared, base.expansion.mean)
    scored = marginal_likelihood.score(free, marginal_likelihood.expand(free, best))
    totals = [prepared.doubt.averaged(each.log_evidence) for each in (base, scored)]
    return (free, scored) if level_share(*totals) > levels.LEVEL_ODDS else None


def calibrated_base(
    problem: Problem, seed: int, progress: Progress
) -> tuple[PreparedProblem, ScoredHypothesis, bool]:
    """The calibrated bare model, and whether the noise is known.

    Where neither sd nor repeats are given the sd is guessed from the residuals of the calibrated model
    itself: then only the shape of a misfit can be tested, never its size.
    """
    progress("calibrating the model", 0.1)
    prepared = prepare(problem, problem.visible(), seed)
    if prepared.rows.size > 0:
        return *calibrated(prepared), True
    scatter = {name: first_guess(problem, name) for name in set(problem.visible().observable)}
    for _ in range(GUESS_ROUNDS - 1):
        scatter |= residual_scatter(*calibrated_with_scatter(problem, scatter, seed), scatter)
    return *calibrated_with_scatter(problem, scatter, seed), False


def calibrated(prepared: PreparedProblem) -> tuple[PreparedProblem, ScoredHypothesis]:
    """Bare model at its best; notes on the calibration are among the warnings."""
    prepared, best, notes = fit_base(prepared)
    prepared = replace(prepared, warnings=(*prepared.warnings, *notes))
    return prepared, marginal_likelihood.score(prepared, marginal_likelihood.expand(prepared, best))


def calibrated_with_scatter(
    problem: Problem, scatter: dict[str, float], seed: int
) -> tuple[PreparedProblem, ScoredHypothesis]:
    """The bare model calibrated as if the scatter were known."""
    supposed = replace(problem, measurements=with_scatter(problem, scatter))
    prepared = prepare(supposed, supposed.visible(), seed)
    unchecked = unchecked_noise_sentence(prepared.rows.freedom)
    warnings = tuple(words for words in prepared.warnings if words != unchecked)
    return calibrated(replace(prepared, warnings=warnings))


def residual_scatter(
    prepared: PreparedProblem, base: ScoredHypothesis, scatter: dict[str, float]
) -> dict[str, float]:
    """Scatter of the residuals of every observable with more than one row; never quite zero."""
    residual = prepared.rows.z - base.expansion.mean
    return {
        observable.name: max(float(np.std(residual[rows])), 1e-9 * scatter[observable.name])
        for observable, rows in prepared.by_observable()
        if rows.sum() > 1
    }


def first_guess(problem: Problem, name: str) -> float:
    """Half the spread of an observable on its comparison scale; 1 % of its size if it does not spread."""
    table = problem.visible()
    chosen = np.array([entry == name for entry in table.observable])
    z = to_scale(problem.observables.get(name, Observable(name)), table.value[chosen])
    z = z[np.isfinite(z)]
    if z.size == 0:
        return 1.0
    return max(0.5 * float(np.std(z)), 0.01 * float(np.abs(z).mean()), 1e-12)


def with_scatter(problem: Problem, scatter: dict[str, float]) -> Measurements:
    """The table with a guessed sd in every row."""
    table = problem.measurements
    sd = np.full(table.size, np.nan)
    for row, name in enumerate(table.observable):
        observable = problem.observables.get(name, Observable(name))
        value: Floats = np.where(table.censored, table.limit, table.value)[[row]]
        steep = float(slope(observable, value)[0])
        if name in scatter and steep > 0.0:
            sd[row] = scatter[name] / steep
    return replace(table, sd=sd, n=np.ones(table.size))
