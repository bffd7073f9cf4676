"""Adoption of effects: everything is calibrated anew, and the vault is opened once.

Beside them stand two controls, fitted in the same way: the best of the other candidates and one drawn
at random. A falling error on held-out rows is supporting evidence; in one case in ten it is luck.
`adopted_files.py` writes the study in which the effect belongs to the model.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import nan
from time import perf_counter

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.agreement_words import refuted
from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.documents import adoption_sentence
from taichi_erosion.evidence.answers.effect_action import effect_actions
from taichi_erosion.evidence.answers.held_out_misfit import (
    PredictedFit,
    held_out_prediction,
    held_out_problem,
    on_common_rows,
    with_silent_sources,
)
from taichi_erosion.evidence.data.findings import Adoption, HypothesisFit
from taichi_erosion.evidence.data.mechanism_findings import DoseEstimate
from taichi_erosion.evidence.data.problem import Problem, Progress, expected_strength
from taichi_erosion.evidence.inference.doses.dose_inference import held_out_doses
from taichi_erosion.evidence.inference.familywise_test import familywise_test
from taichi_erosion.evidence.inference.goodness_of_fit import (
    calibration_covariance,
    chi_square,
    misfit_p,
    misfit_places,
    rows_table,
)
from taichi_erosion.evidence.inference.intervals.estimates import correlations, estimates_alone
from taichi_erosion.evidence.inference.map_fit import Fit, fit, fit_base, fit_free_levels
from taichi_erosion.evidence.inference.marginal_likelihood import expand, score
from taichi_erosion.evidence.inference.pipeline import enough_for_levels, level_share
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, prepare
from taichi_erosion.evidence.inference.screen import Screen, screen
from taichi_erosion.evidence.inference.search.effect_sets import stronger_fit
from taichi_erosion.evidence.inference.verdict_levels import LEVEL_ODDS, fails


def adopt(
    problem: Problem,
    effects: Sequence[str],
    seed: int,
    progress: Progress = no_progress,
    others: Sequence[str] = (),
) -> Adoption:
    """Errors before and after effects are added, on fitted and on held-out rows, with both controls.

    `others` were named with them and are not adopted: what the model does with all of them is fitted too.
    """
    start = perf_counter()
    order = problem.candidate_names
    if missing := [name for name in effects if name not in order]:
        raise BadInput(f"adopt: {missing[0]} is not among the candidates")
    chosen, every = (tuple(sorted(names, key=order.index)) for names in (effects, {*effects, *others}))
    prepared = prepare(problem, problem.visible(), seed)
    if prepared.rows.size == 0:
        raise BadInput("adopt: no row has a known scatter; give sd or repeats")
    progress("calibrating the bare model", 0.1)
    ready = account_of(prepared, every)
    prepared, screened = ready.prepared, ready.screened
    held = held_out_problem(prepared)
    wrong = [() if name is None else (name,) for name in controls(prepared, screened, every, seed)]
    sets = (chosen, *wrong, every if every != chosen else ())
    fits, doses = fitted_sets(ready, held, sets, progress)
    fits, silent = with_silent_sources(prepared, fits)
    bare, added, best_wrong, random_wrong, with_all = on_common_rows(fits)
    assert bare is not None
    assert added is not None
    found = Adoption(
        effect="+".join(chosen),
        base=bare,
        added=added,
        best_wrong=best_wrong,
        random_wrong=random_wrong,
        with_all=with_all,
        held_out=held.rows.size if held else 0,
        where=misfit_places(prepared, screened.base),
        doses=doses,
        unstated_scatter=tuple(silent),
        vault_opened=problem.vault.opened + (1 if held else 0),
        runs=prepared.predictor.cost.runs + (held.predictor.cost.runs if held else 0),
        wall_s=perf_counter() - start,
    )
    return judged(found)


def judged(found: Adoption) -> Adoption:
    """The adoption with what the held-out rows say about it."""
    base, after = found.base, found.with_all or found.added
    worse = (
        after.vault_chi2_per_row >= base.vault_chi2_per_row or after.vault_log_score < base.vault_log_score
    )
    found = replace(
        found, contradicted=bool(worse or refuted(base.vault_chi2_per_row, after.vault_chi2_per_row))
    )
    return replace(found, sentence=adoption_sentence(found))


@dataclass(frozen=True)
class BareAccount:
    """The calibrated bare model with its screen, on one account of the errors that rows share."""

    prepared: PreparedProblem
    base: Fit
    screened: Screen


def fitted_sets(
    ready: BareAccount, held: PreparedProblem | None, sets: Sequence[tuple[str, ...]], progress: Progress
) -> tuple[list[PredictedFit | None], tuple[DoseEstimate, ...]]:
    """The bare model and every set of effects on both sides, and the doses of the first set."""
    prepared, doses = ready.prepared, tuple[DoseEstimate, ...]()
    fits: list[PredictedFit | None] = [evaluated(prepared, ready.base, held, ready.base)]
    for index, names in enumerate(sets):
        progress(f"recalibrating with {' and '.join(names)}", 0.2 * (index + 1))
        best = added_fit(prepared, ready.screened, names) if names else None
        if index == 0 and held is not None and best is not None:
            doses = law_doses(prepared, best, held)
        fits.append(None if best is None else evaluated(prepared, best, held, ready.base))
    return fits, doses


def law_doses(prepared: PreparedProblem, best: Fit, held: PreparedProblem) -> tuple[DoseEstimate, ...]:
    """Doses that held-out rows ask for where one law of a mechanism was adopted; else none."""
    laws = [prepared.candidate(name) for name in best.names]
    if len(laws) != 1 or laws[0].dose is None:
        return ()
    covariance = calibration_covariance(prepared, expand(prepared, best))
    return held_out_doses(held, best, laws[0], covariance[1:, 1:])


def account_of(prepared: PreparedProblem, names: tuple[str, ...]) -> BareAccount:
    """The bare model with stated errors, or with free levels where the effects fit better so."""
    prepared, base, _ = fit_base(prepared)
    stated = BareAccount(prepared, base, screen(prepared, expand(prepared, base)))
    if not fails(misfit_p(prepared, stated.screened.base)) or not enough_for_levels(prepared):
        return stated
    free, best = fit_free_levels(prepared, stated.screened.base.mean)
    freed = BareAccount(free, best, screen(free, expand(free, best)))
    share = level_share(log_evidence(stated, names), log_evidence(freed, names))
    return freed if share > LEVEL_ODDS else stated


def log_evidence(account: BareAccount, names: tuple[str, ...]) -> float:
    """Ln evidence of the model with some effects, or of the bare one where that is larger."""
    prepared, best = account.prepared, added_fit(account.prepared, account.screened, names)
    scores = [score(prepared, expansion) for expansion in (account.screened.base, expand(prepared, best))]
    return max(prepared.doubt.averaged(each.log_evidence) for each in scores)


def controls(
    prepared: PreparedProblem, screened: Screen, effects: Sequence[str], seed: int
) -> tuple[str | None, str | None]:
    """Names of the best other candidate in the screen and of one more, drawn by the seed."""
    test = familywise_test(prepared, screened, np.ones(1), seed)
    order = [screened.signatures[int(i)] for i in np.argsort(-test.observed)]
    others = [each.name for each in order if each.name not in effects and each.resolved]
    if not others:
        return None, None
    rest = sorted(others[1:])
    return others[0], str(np.random.default_rng(seed).choice(rest)) if rest else None


def added_fit(prepared: PreparedProblem, screened: Screen, names: tuple[str, ...]) -> Fit:
    """Best calibration with more effects, from the bare model's best, the prior mean, and one by one."""
    likely = [screened.signature(name).likely_strength(screened.residual) for name in names]
    expected = [expected_strength(prepared.candidate(name)) for name in names]
    starts = [np.append(screened.base.fit.x, likely), np.append(prepared.prior_mean, expected)]
    if len(names) > 1:
        first = fit(prepared, names[:1], [start[: len(prepared.axes) + 1] for start in starts])
        starts.append(np.concatenate([first.x, first.psi, expected[1:]]))
    best = fit(prepared, names, starts)
    return stronger_fit(prepared, expand(prepared, best)) or best


def evaluated(prepared: PreparedProblem, best: Fit, held: PreparedProblem | None, bare: Fit) -> PredictedFit:
    """One hypothesis on the visible rows, and what it says of the held-out ones."""
    expansion = expand(prepared, best)
    strengths, parameters = estimates_alone(prepared, score(prepared, expansion), bare.x)
    found = HypothesisFit(
        effects=best.names,
        strengths=strengths,
        parameters=parameters,
        chi2_per_row=chi_square(prepared, expansion) / prepared.rows.size,
        vault_chi2_per_row=nan,
        vault_rmse={},
        rows=rows_table(prepared, expansion),
        vault_rows=None,
        actions=effect_actions(prepared, best),
        correlations=correlations(prepared, expansion),
    )
    return found, None if held is None else held_out_prediction(prepared, expansion, held)
