"""Which effect is missing, as far as these measurements show: the analysis as a record of findings.

Every candidate is present, excluded above a strength, or not testable, with the reason.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import log, nan
from time import perf_counter
from typing import Any

import numpy as np

from taichi_erosion.evidence.answers.compare import calibrated_base, possible_scatter
from taichi_erosion.evidence.answers.documents import discovery_sentences
from taichi_erosion.evidence.answers.effect_action import effect_actions, opposed_signs
from taichi_erosion.evidence.answers.finding_sentences import mechanism_sentences
from taichi_erosion.evidence.data.findings import (
    NONE,
    OUTSIDE,
    Discovery,
    EffectFinding,
    Estimate,
    MemberFinding,
    NearestHypothesis,
    PlausibleHypothesis,
    RowMisfit,
    RowOff,
    Status,
    VaultErrors,
)
from taichi_erosion.evidence.data.number_words import plain
from taichi_erosion.evidence.data.problem import Budget, Candidate, Problem, Progress, expected_strength
from taichi_erosion.evidence.data.transforms import split_setting
from taichi_erosion.evidence.inference import goodness_of_fit
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.confounding import absorbed_by, confounded_effects
from taichi_erosion.evidence.inference.cross_validation import ScoreGain
from taichi_erosion.evidence.inference.doses.mechanism_search import beyond_list, challenge, missing, named
from taichi_erosion.evidence.inference.doses.named_strength import nearest_trend, strength_trend
from taichi_erosion.evidence.inference.familywise_test import power
from taichi_erosion.evidence.inference.intervals.estimates import (
    acting_strengths,
    averaged,
    calibrated_numbers,
    correlations,
    estimates_alone,
)
from taichi_erosion.evidence.inference.intervals.model_averaging import Average
from taichi_erosion.evidence.inference.marginal_likelihood import ScoredHypothesis, projected_residual
from taichi_erosion.evidence.inference.pipeline import Analysis, confirmed_analysis
from taichi_erosion.evidence.inference.posterior import (
    label,
    level_shifts,
    parameter_estimates,
    strength_estimates,
    upper_strength,
)
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, prepare
from taichi_erosion.evidence.inference.refit import FittedHypothesis
from taichi_erosion.evidence.inference.residual_structure import residual_trends, varying_number
from taichi_erosion.evidence.inference.robustness.error_findings import error_findings, likeliest_words
from taichi_erosion.evidence.inference.robustness.variants import variants
from taichi_erosion.evidence.inference.screen import Signature
from taichi_erosion.evidence.inference.verdict import Decision

MOST_PLAUSIBLE = 6
TEXTBOOK = 1.0  # strength of an effect as its source states it [1]


@dataclass(frozen=True)
class Answer:
    """The record of a discovery with the analysis behind it."""

    record: Discovery
    analysis: Analysis | None = None  # None where nothing may be named
    beyond: Mapping[str, Any] = field(default_factory=dict)  # fields of the record on mechanisms


def discover(problem: Problem, seed: int, budget: Budget, progress: Progress) -> Discovery:
    """The whole analysis; names nothing where the noise is unknown or no candidate is listed."""
    return analysed(problem, seed, budget, progress).record


def analysed(problem: Problem, seed: int, budget: Budget, progress: Progress) -> Answer:
    """The same with what it rests on."""
    start = perf_counter()
    problem = replace(problem, budget=budget)
    prepared = prepare(problem, problem.visible(), seed)
    if prepared.rows.size == 0 or not problem.candidates:
        found = Answer(nameless_discovery(problem, seed, progress))
    else:
        analysis, beyond = with_beyond(confirmed_analysis(prepared, seed, progress))
        found = Answer(record_of(analysis, beyond, seed), analysis, beyond)
    return replace(found, record=replace(found.record, wall_s=perf_counter() - start))


def discovery_of(found: Analysis, seed: int) -> Discovery:
    """The record of an analysis."""
    found, beyond = with_beyond(found)
    return record_of(found, beyond, seed)


def record_of(found: Analysis, beyond: Mapping[str, Any], seed: int) -> Discovery:
    """The record of an analysis that has stood beside mechanisms."""
    prepared, screened = found.fitted.prepared, found.fitted.screened
    whole = averaged(found)
    strengths = fitted_strengths(found, whole)
    expected = {name: estimate.value for name, estimate in strengths.items()}
    base = found.fitted.base.expansion
    record = Discovery(
        **shared_fields(prepared, found.fitted.base.scored, found.final.scored, seed),
        **number_fields(found, whole),
        verdict=found.decision.verdict,
        named=found.decision.named,
        group=found.decision.group,
        probabilities=found.posterior.probability,
        effects=effect_findings(found, strengths),
        where=found.places,
        p=found.test.p,
        p_misfit=found.p_misfit,
        p_misfit_after=found.p_misfit_after,
        decoy_rank=found.test.decoy_rank,
        stability=found.stability,
        warnings=(*prepared.warnings, *found.warnings, *bound_warnings(found)),
        opposed=opposed_signs(prepared, found.final.expansion.fit),
        levels=level_shifts(prepared, found.final.scored),
        **error_fields(found),
        stuck=tuple(goodness_of_fit.stuck_numbers(prepared, base)),
        stuck_after=tuple(goodness_of_fit.stuck_numbers(prepared, found.final.expansion)),
        range_suffices=found.range_suffices,
        noise=goodness_of_fit.noise_table(prepared, screened.seed_correlation),
        ambiguity=confounded_effects(prepared, screened, expected),
        absorbed_by=absorbed_by(prepared, screened),
        members=member_findings(found),
        probability_unvisited=found.unvisited.get("", 0.0),
        survivors=plausible_hypotheses(found),
        closest=closest_hypotheses(found),
        **unlisted_fields(found),
        **beyond,
    )
    # variants have evaluated the model too
    return replace(record, runs=prepared.predictor.cost.runs, sentences=discovery_sentences(record))


def number_fields(found: Analysis, whole: Average) -> dict[str, Any]:
    """Calibrated numbers with averaged intervals, and their correlations."""
    return {
        "parameters": calibrated_numbers(whole, found.final, found.fitted.base.fit.x),
        "correlations": correlations(found.fitted.prepared, found.final.expansion),
    }


def unlisted_fields(found: Analysis) -> dict[str, Any]:
    """What there is to see where no listed effect explains a misfit; nothing elsewhere."""
    if found.decision.verdict != "outside_library":
        return {}
    prepared, base = found.fitted.prepared, found.fitted.base.expansion
    return {
        "clues": residual_trends(prepared, base, found.places),
        "varying": varying_number(prepared, base),
        "nearest": nearest_hypothesis(found),
    }


def error_fields(found: Analysis) -> dict[str, Any]:
    """What an answer rests on: errors that nobody stated, and the variants in which it holds."""
    return {
        "worst_row": stated_worst_row(found),
        "row_off": stated_row_off(found),
        "level_probability": found.level_probability,
        "p_misfit_stated": found.p_misfit_stated,
        "errors": error_findings(found),
        "errors_probability": found.errors_probability,
        "errors_stated": likeliest_words(found.stated.posterior) if found.stated else "",
        "variants": variants(found),
        "scatter_factor": possible_scatter(found.fitted.prepared, found.fitted.base.expansion),
    }


def member_findings(found: Analysis) -> tuple[MemberFinding, ...]:
    """Tests of the members of a set of three or more effects."""
    return tuple(
        MemberFinding(each.name, each.rest, each.gain, each.p, each.needed) for each in found.members
    )


def stated_worst_row(found: Analysis) -> RowMisfit | None:
    """The row that holds most of the misfit of the bare model, with its error as stated."""
    fitted = found.stated.fitted if found.stated else found.fitted
    return goodness_of_fit.worst_row(fitted.prepared, fitted.base.expansion)


def stated_row_off(found: Analysis) -> RowOff | None:
    """The row that no explanation comes near, with its error as stated."""
    fitted = found.stated.fitted if found.stated else found.fitted
    expansions = [each.expansion for each in (fitted.base, *fitted.refits)]
    return goodness_of_fit.row_off(fitted.prepared, expansions)


def with_beyond(found: Analysis) -> tuple[Analysis, dict[str, Any]]:
    """Mechanisms, where the model has places for them and the list explains a misfit badly; the answer then.

    What is named is weighed against them too.
    """
    verdict, prepared = found.decision.verdict, found.fitted.prepared
    trend = strength_trend(prepared, found.final)
    if verdict == "outside_library":
        trend = nearest_trend(prepared, found.fitted.refits)
    if not (missing(verdict, found) or named(verdict)) or not prepared.problem.mechanisms:
        return found, {"trend": trend}
    found, beyond = challenge(found) if named(verdict) else (found, beyond_list(found.fitted))
    told = replace(beyond, sentences=mechanism_sentences(beyond))
    return found, {"beyond": told, "trend": None if beyond.withdrawn else trend}


def nameless_discovery(problem: Problem, seed: int, progress: Progress) -> Discovery:
    """The record where nothing may be named: only where the model fails."""
    prepared, base, known = calibrated_base(problem, seed, progress)
    names = problem.candidate_names
    record = Discovery(
        **shared_fields(prepared, base, base, seed),
        parameters=estimates_alone(prepared, base)[1],
        verdict="not_testable",
        probabilities=dict.fromkeys((NONE, OUTSIDE, *names), 1.0 / (len(names) + 2)),
        effects={name: EffectFinding(sentence=f"{name}: not testable") for name in names},
        where=goodness_of_fit.misfit_places(prepared, base.expansion),
        decoy_rank=len(names) + 1,
        warnings=prepared.warnings,
        noise=goodness_of_fit.noise_table(prepared, known=known),
    )
    if not known:
        unknown = {"chi2_before": nan, "chi2_after": nan}
        record = replace(record, **unknown, chi2_per_row_before=nan, chi2_per_row_after=nan)
    return replace(record, sentences=discovery_sentences(record))


def shared_fields(
    prepared: PreparedProblem, base: ScoredHypothesis, final: ScoredHypothesis, seed: int
) -> dict[str, Any]:
    """Fields that do not depend on what is named, from the bare model and the recalibrated one."""
    n = max(prepared.rows.size, 1)
    before, after = (goodness_of_fit.chi_square(prepared, each.expansion) for each in (base, final))
    return {
        "calibrated": len(prepared.axes),
        "calibrated_with": final.expansion.fit.names,
        "chi2_before": before,
        "chi2_after": after,
        "chi2_per_row_before": before / n,
        "chi2_per_row_after": after / n,
        "n": prepared.rows.size,
        "vault": VaultErrors(prepared.problem.vault.opened),
        "rows_before": goodness_of_fit.rows_table(prepared, base.expansion),
        "rows_after": goodness_of_fit.rows_table(prepared, final.expansion),
        "actions": effect_actions(prepared, final.expansion.fit),
        "failures": prepared.predictor.cost.failures,
        "runs": prepared.predictor.cost.runs,
        "seed": seed,
    }


@dataclass(frozen=True)
class Unexplained:
    """One candidate against what the final hypothesis leaves unexplained."""

    norm: float  # of its signature at expected strength, beyond calibration and named effects
    absorption: float
    strength: Estimate  # that would fit the rest best, up to the one excluded with 95 %


def unexplained(found: Analysis, signature: Signature) -> Unexplained:
    """Signature projected on what neither calibration nor the effects of the final hypothesis can imitate.

    What the model leaves unexplained beyond noise could hide an effect too: the noise is taken to be as large
    as the misfit per degree of freedom.
    """
    prepared = found.fitted.prepared
    left = projected_residual(prepared, found.final.expansion)
    excess = max(1.0, float(left.free @ left.free) / max(goodness_of_fit.freedom(left), 1.0))
    free = left.project_signature(signature.raw)
    at = signature.at(expected_strength(prepared.candidate(signature.name)))
    kept = max(1.0 - signature.noise, 0.0) ** 0.5
    norm, size = float(np.linalg.norm(free[at])), float(np.linalg.norm(signature.raw[at]))
    fall = 2.0 * free[:, : prepared.rows.size] @ left.free - np.einsum("ij,ij->i", free, free)
    best, upper = (
        float(signature.grid[int(np.argmax(fall))]),
        upper_strength(signature.grid, 0.5 * fall / excess),
    )
    absorption = 1.0 - norm / size if size > 0.0 else 0.0
    return Unexplained(norm * kept / excess**0.5, absorption, Estimate(best, 0.0, upper, False))


def effect_findings(found: Analysis, strengths: dict[str, Estimate]) -> dict[str, EffectFinding]:
    """One finding per candidate, in the study's order."""
    return {
        signature.name: effect_finding(found, signature, strengths.get(signature.name), float(p))
        for signature, p in zip(found.fitted.screened.signatures, found.test.step_down, strict=True)
    }


def effect_finding(
    found: Analysis, signature: Signature, strength: Estimate | None, p: float
) -> EffectFinding:
    """What is known about one candidate; `strength` where it was refitted."""
    name, decision, posterior = signature.name, found.decision, found.posterior
    acts = name in found.final.names
    if acts:
        rest = Unexplained(signature.norm, signature.absorption, Estimate(0.0, 0.0, nan, False))
    else:
        rest = unexplained(found, signature)
    strong = power(rest.norm, found.test.threshold)
    status: Status = "excluded"  # silence means absence only where the effect would have been seen
    if name in decision.accepted or strong < levels.TESTABLE_POWER:
        status = "present" if name in decision.named else "not_testable"
    if strength is None or not (acts or name in decision.accepted):
        strength = rest.strength
    favoured = posterior.log_bayes.get(name, 0.0) > log(levels.POSITIVE_ODDS)
    if status == "excluded" and (favoured or strength.high >= TEXTBOOK):
        status = "not_testable"  # an effect that is favoured, or possible at its textbook value, is open
    gain, listed = found.gains.get(name, ScoreGain()), found.fitted.prepared.candidate(name)
    return EffectFinding(
        status=status,
        strength=strength.value,
        strength_low=strength.low,
        strength_high=strength.high,
        strength_high_kind="interval_90" if acts or name in decision.accepted else "limit_95",
        log_bayes_factor=posterior.log_bayes.get(name, 0.0),
        power=strong,
        absorption=rest.absorption,
        signature_norm=rest.norm,
        probability=posterior.inclusion.get(name, 0.0),
        probability_unvisited=found.unvisited.get(name, 0.0),
        probability_alone=posterior.probability.get(name, 0.0),
        p=p,
        held_out_gain=gain.gain,
        held_out_error=gain.error,
        stronger_than_list=acts and strength.value > listed.maximum,
        sentence=f"{name}: {effect_reason(signature, status, strength, decision, rest.absorption, listed)}",
    )


def effect_reason(
    signature: Signature,
    status: Status,
    strength: Estimate,
    decision: Decision,
    absorption: float,
    listed: Candidate,
) -> str:
    """Why a candidate has its status."""
    if status == "present":
        interval = f"{strength.value:.2g} ({strength.low:.2g} to {strength.high:.2g})"
        if strength.value > listed.maximum:
            return (
                f"consistent with the measurements at strength {interval}, stronger than the list allows "
                f"(up to {listed.maximum:.2g})"
            )
        if strength.at_bound:
            return (
                f"consistent with the measurements at strength {interval}, which ends at the largest that "
                "the list allows: a stronger effect, or another law"
            )
        return f"consistent with the measurements at strength {interval}"
    if decision.verdict == "unstable" and signature.name in decision.accepted:
        return "explains the misfit in some runs of the model and not in others"
    if signature.name in decision.group:
        others = ", ".join(other for other in decision.group if other != signature.name)
        return f"explains the misfit, but is not distinguished from {others}"
    if status == "excluded":
        return f"excluded above strength {strength.high:.2g}"
    return untestable_reason(signature, strength, absorption)


def untestable_reason(signature: Signature, strength: Estimate, absorption: float) -> str:
    """Why these measurements do not tell whether a candidate acts."""
    if signature.norm > levels.SEPARATION and absorption <= levels.ABSORBED:
        return f"not excluded: strengths up to {strength.high:.2g} remain possible"
    if not np.any(signature.raw):
        return "cannot act in any measured condition"
    if signature.noise > levels.NOISE_LIMIT and signature.norm <= 1.0:
        return "its signature is not resolved from the model's own scatter; more seeds would tell"
    if absorption > levels.ABSORBED:
        return f"hardly distinguishable from a change of the calibrated numbers ({absorption:.0%} imitated)"
    return "not testable with these measurements"


def fitted_strengths(found: Analysis, whole: Average) -> dict[str, Estimate]:
    """Strengths of every refitted single, and of the final hypothesis where it has more than one effect."""
    strengths: dict[str, Estimate] = {}
    for item in [*(each for each in found.fitted.refits if len(each.names) == 1), found.final]:
        strengths |= acting_strengths(whole, found.fitted.prepared, item)
    return strengths


def plausible_hypothesis(found: Analysis, item: FittedHypothesis) -> PlausibleHypothesis:
    """A fitted hypothesis with its probability and numbers."""
    parameters, adopted = split_setting(found.fitted.prepared.axes, item.fit.x)
    probability = found.posterior.probability.get(label(item.names), 0.0)
    return PlausibleHypothesis(item.names, probability, parameters, {**adopted, **item.fit.acting()})


def plausible_hypotheses(found: Analysis) -> tuple[PlausibleHypothesis, ...]:
    """Explanations between which the next experiment has to decide, likeliest first; two at least."""
    fitted = [plausible_hypothesis(found, item) for item in [found.fitted.base, *found.fitted.refits]]
    fitted.sort(key=lambda each: -each.probability)
    kept = [each for k, each in enumerate(fitted) if k < 2 or each.probability > levels.PLAUSIBLE]
    return tuple(kept[:MOST_PLAUSIBLE])


def closest_hypotheses(found: Analysis) -> tuple[PlausibleHypothesis, ...]:
    """The single effect and the set of several that leave the least misfit, however unlikely."""
    singles, several = [], []
    for item in found.fitted.refits:
        (several if len(item.names) > 1 else singles).append(item)
    best = [min(items, key=lambda item: item.fit.misfit) for items in (singles, several) if items]
    return tuple(plausible_hypothesis(found, item) for item in best)


def nearest_hypothesis(found: Analysis) -> NearestHypothesis | None:
    """The refit that takes away most of the misfit, where it takes away `levels.REPORTED_CLOSEST` of it."""
    prepared, base = found.fitted.prepared, found.fitted.base.expansion
    tried = [
        (goodness_of_fit.explained_share(prepared, base, i.expansion), i)
        for i in found.fitted.refits
        if i.usable
    ]
    share, item = max(tried, key=lambda pair: pair[0], default=(0.0, found.fitted.base))
    if share < levels.REPORTED_CLOSEST:
        return None
    strengths = strength_estimates(prepared, item.scored)
    ends = tuple(name for name, strength in strengths.items() if strength.at_bound)
    return NearestHypothesis(item.names, share, goodness_of_fit.misfit_p(prepared, item.expansion), ends)


def bound_warnings(found: Analysis) -> list[str]:
    """Calibrated numbers of the bare model that end at a bound of their range."""
    estimates = parameter_estimates(found.fitted.prepared, found.fitted.base.scored)
    return [
        f"{path}: the calibration of the bare model ends at the bound of its range ({plain(number.value)})"
        for path, number in estimates.items()
        if number.at_bound
    ]
