"""The proof: an effect enters the model, everything is calibrated anew, and the vault is opened once.

Beside the effect stand two controls, fitted in the same way: the best of the other candidates and one drawn
at random. A falling error on held-out rows is supporting evidence; one case in ten says otherwise by luck.
"""

from dataclasses import dataclass, replace
from math import nan
from time import perf_counter

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.data.comparison_rows import ComparisonRows, comparison_rows
from taichi_erosion.evidence.data.findings import Adoption, HypothesisFit, Rows
from taichi_erosion.evidence.data.linear_algebra import projection, working
from taichi_erosion.evidence.data.problem import Bools, Floats, Problem, Progress
from taichi_erosion.evidence.inference.familywise_test import familywise_test
from taichi_erosion.evidence.inference.goodness_of_fit import chi_square, rows_table
from taichi_erosion.evidence.inference.intervals import parameter_fits, strength_fits
from taichi_erosion.evidence.inference.levels import HELD_OUT_MISFIT, HELD_OUT_SHARE
from taichi_erosion.evidence.inference.map_fit import Fit, fit_base
from taichi_erosion.evidence.inference.marginal_likelihood import expand, score
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, bound_predictor, prepare
from taichi_erosion.evidence.inference.refit import likely_strength, refit
from taichi_erosion.evidence.inference.screen import Screen, screen


@dataclass(frozen=True)
class HeldOutProblem:
    """Held-out rows with the model bound to them; None where the vault is empty."""

    rows: ComparisonRows
    prepared: PreparedProblem


def adopt(problem: Problem, effect: str, seed: int, progress: Progress = no_progress) -> Adoption:
    """Errors before and after one effect is added, on fitted and on held-out rows, with both controls."""
    start = perf_counter()
    if effect not in [candidate.name for candidate in problem.candidates]:
        raise BadInput(f"adopt: {effect} is not among the candidates")
    prepared = prepare(problem, problem.visible(), seed)
    if prepared.rows.size == 0:
        raise BadInput("adopt: no row has a known scatter; give sd or repeats")
    progress("calibrating the bare model", 0.1)
    prepared, base_fit, _ = fit_base(prepared)
    base = expand(prepared, base_fit)
    found = screen(prepared, base)
    best_wrong, random_wrong = controls(prepared, found, effect, seed)
    vault = held_out_problem(prepared, base_fit)
    fits: list[HypothesisFit | None] = [tested(prepared, base_fit, vault)]
    for index, name in enumerate((effect, best_wrong, random_wrong)):
        progress(f"recalibrating with {name}", 0.25 * (index + 1))
        fits.append(None if name is None else tested(prepared, added_fit(prepared, found, name), vault))
    fits = on_common_rows(fits)
    added = fits[1]
    assert added is not None
    assert fits[0] is not None
    runs = prepared.predictor.cost.runs + (vault.prepared.predictor.cost.runs if vault else 0)
    return Adoption(
        effect=effect,
        base=fits[0],
        added=added,
        best_wrong=fits[2],
        random_wrong=fits[3],
        vault_opened=problem.vault.opened + (1 if vault else 0),
        sentence=adoption_sentence(effect, fits[0], added, fits[2], fits[3])
        + missing_rows_sentence(vault, fits[0]),
        runs=runs,
        wall_s=perf_counter() - start,
    )


def controls(
    prepared: PreparedProblem, found: Screen, effect: str, seed: int
) -> tuple[str | None, str | None]:
    """Names of the best other candidate in the screen and of one more, drawn by the seed."""
    seen = familywise_test(prepared, found, np.ones(1), seed)
    order = [found.signatures[int(i)].name for i in np.argsort(-seen.observed)]
    acting = [name for name in order if name != effect and found.signature(name).resolved]
    if not acting:
        return None, None
    rest = sorted(acting[1:])
    return acting[0], str(np.random.default_rng(seed).choice(rest)) if rest else None


def added_fit(prepared: PreparedProblem, found: Screen, name: str) -> Fit:
    """Best calibration with one more effect, from the bare model's best and from the prior's middle."""
    strength = likely_strength(found.signature(name), found.residual)
    middle = np.clip(np.zeros(len(prepared.axes)), prepared.low, prepared.high)
    unit = min(prepared.candidate(name).prior_scale, prepared.candidate(name).maximum)
    return refit(prepared, (name,), [np.append(found.base.fit.x, strength), np.append(middle, unit)])


def held_out_problem(prepared: PreparedProblem, base: Fit) -> HeldOutProblem | None:
    """The held-out rows; a missing variance is that of the visible rows of the same observable.

    All hypotheses are held against the same variance, the bare model's own errors in it.
    """
    problem = prepared.problem
    if problem.vault.rows.size == 0:
        return None
    rows = comparison_rows(problem, problem.hidden())
    typical = {
        prepared.rows.observables[index].name: float(
            np.median(prepared.rows.variance[prepared.rows.which == index])
        )
        for index in np.unique(prepared.rows.which)
    }
    names = [rows.observables[index].name for index in rows.which]
    fallback = np.array([typical.get(name, nan) for name in names])
    rows = replace(rows, variance=np.where(rows.known, rows.variance, fallback))
    rows = rows.rows(rows.known)
    if rows.size == 0:
        return None
    predictor = bound_predictor(problem, rows)
    own = predictor.model_errors(base.x, base.acting())
    variance = rows.variance + simulated_variance(prepared, rows) + np.sum(own**2, axis=1)
    return HeldOutProblem(rows, replace(prepared, rows=rows, predictor=predictor, variance=variance))


def simulated_variance(prepared: PreparedProblem, rows: ComparisonRows) -> Floats:
    """Variance of the judged mean at held-out rows: that of the visible rows of the same observable."""
    names = [observable.name for observable in prepared.rows.observables]
    variance = np.zeros(rows.size)
    for row, index in enumerate(rows.which):
        name = rows.observables[index].name
        if name in names:
            own = prepared.rows.which == names.index(name)
            if own.any():
                variance[row] = float(np.median(prepared.seed_variance[own])) / prepared.seeds.scoring.size
    return variance


def tested(prepared: PreparedProblem, fitted: Fit, vault: HeldOutProblem | None) -> HypothesisFit:
    """One hypothesis on both sides; the residual of a held-out row without a value is NaN."""
    expansion = expand(prepared, fitted)
    scored = score(prepared, expansion)
    visible = rows_table(prepared, expansion)
    hidden = None
    if vault is not None:
        mean = vault.prepared.predictor.mean(fitted.x, fitted.acting(), prepared.seeds.scoring)
        mean = mean + shared_shift(prepared, expansion.mean, vault)
        good = np.isfinite(mean)
        part = replace(expansion, mean=np.where(good, mean, vault.rows.z), shared=vault.rows.shared)
        table = rows_table(vault.prepared, part)
        hidden = replace(table, residual=np.where(good, table.residual, nan))
    return HypothesisFit(
        effects=fitted.names,
        strengths=strength_fits(prepared, scored),
        parameters=parameter_fits(prepared, scored),
        chi2=chi_square(prepared, expansion) / prepared.rows.size,
        vault_chi2=nan,
        vault_rmse={},
        rows=visible,
        vault_rows=hidden,
    )


def shared_shift(prepared: PreparedProblem, mean: Floats, vault: HeldOutProblem) -> Floats:
    """Systematic error of each instrument as the visible rows show it, carried to the held-out rows."""
    shift = np.zeros(vault.rows.size)
    work = working((prepared.rows.z - mean) / prepared.sd, prepared.rows.censored)
    names = [observable.name for observable in vault.rows.observables]
    for index, observable in enumerate(prepared.rows.observables):
        own = prepared.rows.which == index
        column = np.sum(np.abs(prepared.rows.shared[own]), axis=1)
        if not np.any(column) or observable.name not in names:
            continue
        scale = (work.weight[own] / prepared.sd[own]) * column
        size = float(
            projection(np.zeros((scale.size, 0)), scale[:, np.newaxis]).solve(
                np.append(work.residual[own], 0.0)
            )[0]
        )
        hidden = vault.rows.which == names.index(observable.name)
        shift[hidden] = size * np.sum(np.abs(vault.rows.shared[hidden]), axis=1)
    return shift


def errors_by_observable(rows: Rows) -> dict[str, float]:
    """Root mean square error of the held-out rows, in each observable's unit."""
    names = np.array(rows.observable)
    gap = rows.measured - rows.predicted
    return {str(name): float(np.sqrt(np.mean(gap[names == name] ** 2))) for name in np.unique(names)}


def on_common_rows(fits: list[HypothesisFit | None]) -> list[HypothesisFit | None]:
    """All hypotheses on the held-out rows for which each of them has a value."""
    tables = [fit.vault_rows.residual for fit in fits if fit is not None and fit.vault_rows is not None]
    if not tables:
        return fits
    common = np.all(np.isfinite(tables), axis=0)
    return [None if fit is None else scored_on(fit, common) for fit in fits]


def scored_on(fit: HypothesisFit, chosen: Bools) -> HypothesisFit:
    """A hypothesis and its errors on some of the held-out rows."""
    assert fit.vault_rows is not None
    hidden = rows_of(fit.vault_rows, chosen)
    chi2 = float(np.mean(hidden.residual**2)) if chosen.any() else nan
    return replace(fit, vault_chi2=chi2, vault_rmse=errors_by_observable(hidden), vault_rows=hidden)


def rows_of(rows: Rows, chosen: Bools) -> Rows:
    """Some rows of a table."""
    kept = np.flatnonzero(chosen)
    names = ("measured", "measured_sd", "predicted", "predicted_sd", "residual")
    return Rows(
        observable=tuple(rows.observable[i] for i in kept),
        group=tuple(rows.group[i] for i in kept),
        conditions={name: column[chosen] for name, column in rows.conditions.items()},
        **{name: getattr(rows, name)[chosen] for name in names},
    )


def missing_rows_sentence(vault: HeldOutProblem | None, base: HypothesisFit) -> str:
    """How many held-out rows do not count for want of a value; nothing where all do."""
    if vault is None or base.vault_rows is None:
        return ""
    missing = vault.rows.size - len(base.vault_rows.observable)
    return f" For {missing} of {vault.rows.size} held-out rows there is no value." if missing else ""


def adoption_sentence(
    effect: str,
    base: HypothesisFit,
    added: HypothesisFit,
    best_wrong: HypothesisFit | None,
    random_wrong: HypothesisFit | None,
) -> str:
    """What the vault says."""
    if np.isnan(added.vault_chi2):
        return (
            f"With {effect} the misfit per fitted row goes from {base.chi2:.3g} to {added.chi2:.3g}; "
            "no row was held out, so nothing is proved."
        )
    words = (
        f"With {effect} the misfit per held-out row goes from {base.vault_chi2:.3g} to {added.vault_chi2:.3g}"
    )
    wrongs = ((best_wrong, "the best other candidate"), (random_wrong, "a random one"))
    controls_told = [
        f"{w.vault_chi2:.3g} with {what} ({w.effects[0]})" for w, what in wrongs if w is not None
    ]
    words += f"; for comparison {', '.join(controls_told)}." if controls_told else "."
    refuted = base.vault_chi2 > HELD_OUT_MISFIT and added.vault_chi2 > HELD_OUT_SHARE * base.vault_chi2
    return words + (f" What was held out does not bear {effect} out." if refuted else "")
