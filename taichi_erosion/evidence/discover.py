"""Which effect is missing, as far as these measurements can tell: the autopsy put into words."""

from dataclasses import replace
from math import nan
from time import perf_counter

from taichi_erosion.evidence.autopsy import Autopsy, autopsy
from taichi_erosion.evidence.clues import clues_of
from taichi_erosion.evidence.compare import known_or_guessed
from taichi_erosion.evidence.effect_table import Verdicts, effect_table
from taichi_erosion.evidence.examination import examine
from taichi_erosion.evidence.findings import Discovery, EffectFinding, Fitted, Survivor, VaultErrors
from taichi_erosion.evidence.groups import absorbed_by, ambiguity
from taichi_erosion.evidence.intervals import parameter_fits, strength_fits
from taichi_erosion.evidence.misfit import where_it_fails
from taichi_erosion.evidence.posterior import NONE, OUTSIDE, label
from taichi_erosion.evidence.problem import Budget, Problem, Progress
from taichi_erosion.evidence.scales import split_setting
from taichi_erosion.evidence.shortlist import Judged
from taichi_erosion.evidence.tables import chi_square, noise_table, rows_table
from taichi_erosion.evidence.words import summary

SURVIVING = 0.01  # probability below which an explanation is not carried to the next experiment
MOST_SURVIVORS = 6
NO_CANDIDATE = "No candidate is listed, so nothing can be named; `compare` says where the model fails."


def discover(problem: Problem, seed: int, budget: Budget, progress: Progress) -> Discovery:
    """The whole autopsy; refuses to name anything when the noise is unknown."""
    start = perf_counter()
    problem = replace(problem, budget=budget)
    exam = examine(problem, problem.visible(), seed)
    if exam.rows.size == 0 or not problem.candidates:
        return refused(problem, seed, progress, start)
    return worded(autopsy(exam, seed, progress), seed, start)


def worded(found: Autopsy, seed: int, start: float) -> Discovery:
    """Every field of the discovery out of the autopsy."""
    exam, base, final = found.exam, found.base.scored.expansion, found.final.scored.expansion
    strengths = fitted_strengths(found)
    told = Verdicts(found.decision, found.believed, found.seen, final, strengths, found.held_out)
    effects = effect_table(exam, found.found.signatures, told)
    where = found.where
    clues = clues_of(exam, base, where) if found.decision.verdict == "outside_library" else ()
    expected = {name: fitted.value for name, fitted in strengths.items()}
    return Discovery(
        verdict=found.decision.verdict,
        named=found.decision.named,
        group=found.decision.group,
        probabilities=found.believed.probability,
        effects=effects,
        parameters=parameter_fits(exam, found.final.scored),
        where=where,
        chi2_before=chi_square(exam, base),
        chi2_after=chi_square(exam, final),
        n=exam.rows.size,
        vault=VaultErrors(exam.problem.vault.opened, nan, nan, nan),
        next_experiments=(),
        clues=clues,
        p=found.seen.p,
        p_misfit=found.p_misfit,
        p_misfit_after=found.p_misfit_after,
        decoy_rank=found.seen.decoy_rank,
        stability=found.stability,
        sentences=summary(found, effects, where, clues),
        warnings=(*exam.warnings, *found.warnings, *bound_warnings(found)),
        noise=noise_table(exam, found.found.seed_correlation),
        ambiguity=ambiguity(exam, found.found, expected),
        absorbed_by=absorbed_by(exam, found.found),
        survivors=survivors_of(found),
        closest=closest_of(found),
        rows_before=rows_table(exam, base),
        rows_after=rows_table(exam, final),
        failures=exam.predictor.ledger.failures,
        runs=exam.predictor.ledger.runs,
        wall_s=perf_counter() - start,
        seed=seed,
    )


def fitted_strengths(found: Autopsy) -> dict[str, Fitted]:
    """Strengths of every refitted single, and of the final hypothesis where it has more than one effect."""
    strengths: dict[str, Fitted] = {}
    for item in found.judged:
        if len(item.names) == 1:
            strengths |= strength_fits(found.exam, item.scored)
    return strengths | strength_fits(found.exam, found.final.scored)


def survivor_of(found: Autopsy, item: Judged) -> Survivor:
    """One judged hypothesis as something that an experiment or a simulation can be about."""
    probability = found.believed.probability.get(label(item.names), 0.0)
    parameters, adopted = split_setting(found.exam.axes, item.scored.expansion.fit.x)
    strengths = {**adopted, **item.scored.expansion.fit.acting()}
    return Survivor(item.names, probability, parameters, strengths)


def survivors_of(found: Autopsy) -> tuple[Survivor, ...]:
    """Explanations that the next experiment has to tell apart."""
    survivors = [survivor_of(found, item) for item in [found.base, *found.judged]]
    survivors.sort(key=lambda survivor: -survivor.probability)
    kept = [s for k, s in enumerate(survivors) if k < 2 or s.probability > SURVIVING]
    return tuple(kept[:MOST_SURVIVORS])


def closest_of(found: Autopsy) -> tuple[Survivor, ...]:
    """The single effect and the pair that leave the least misfit, however unlikely."""
    sizes = [[item for item in found.judged if len(item.names) == count] for count in (1, 2)]
    return tuple(
        survivor_of(found, min(items, key=lambda item: item.scored.expansion.fit.misfit))
        for items in sizes
        if items
    )


def bound_warnings(found: Autopsy) -> list[str]:
    """Calibrated numbers of the bare model that want to leave their range."""
    fits = parameter_fits(found.exam, found.base.scored)
    return [
        f"{path}: the calibration of the bare model ends at the bound of its range ({fit.value:.3g})"
        for path, fit in fits.items()
        if fit.at_bound
    ]


def untested(name: str) -> EffectFinding:
    """Row of a candidate that nothing was asked about."""
    words = f"{name}: not testable"
    return EffectFinding("not_testable", nan, nan, nan, 0.0, 0.0, nan, nan, 0.0, 1.0, nan, nan, words)


def refused(problem: Problem, seed: int, progress: Progress, start: float) -> Discovery:
    """Nothing is named where the noise is unknown or no candidate is listed; only where the model fails."""
    exam, base, known = known_or_guessed(problem, seed, progress)
    nothing = {candidate.name: untested(candidate.name) for candidate in problem.candidates}
    share = 1.0 / (len(nothing) + 2)
    noise = noise_table(exam, None, known)
    rows = rows_table(exam, base.expansion)
    chi2 = chi_square(exam, base.expansion) if known else nan
    return Discovery(
        verdict="not_testable",
        named=(),
        group=(),
        probabilities={NONE: share, OUTSIDE: share} | dict.fromkeys(nothing, share),
        effects=nothing,
        parameters=parameter_fits(exam, base),
        where=where_it_fails(exam, base.expansion),
        chi2_before=chi2,
        chi2_after=chi2,
        n=exam.rows.size,
        vault=VaultErrors(problem.vault.opened, nan, nan, nan),
        next_experiments=(),
        clues=(),
        p=1.0,
        p_misfit=nan,
        p_misfit_after=nan,
        decoy_rank=len(nothing) + 1,
        stability=1.0,
        sentences=noise.sentences if problem.candidates else (NO_CANDIDATE, *noise.sentences),
        warnings=exam.warnings,
        noise=noise,
        ambiguity={},
        absorbed_by={},
        survivors=(),
        closest=(),
        rows_before=rows,
        rows_after=rows,
        failures=exam.predictor.ledger.failures,
        runs=exam.predictor.ledger.runs,
        wall_s=perf_counter() - start,
        seed=seed,
    )
