"""The row of every candidate: present, excluded above a strength, or not testable, and why.

Which effect is missing, as far as these measurements can tell: the autopsy put into words.
"""

from dataclasses import dataclass, replace
from math import nan
from time import perf_counter

import numpy as np

from taichi_erosion.evidence.answers.compare import calibrated_base
from taichi_erosion.evidence.answers.sentences import summary
from taichi_erosion.evidence.data.findings import (
    Discovery,
    EffectFinding,
    Estimate,
    PlausibleHypothesis,
    Status,
    VaultErrors,
)
from taichi_erosion.evidence.data.linear_algebra import stack_signature
from taichi_erosion.evidence.data.problem import Budget, Problem, Progress, expected_strength
from taichi_erosion.evidence.data.transforms import split_setting
from taichi_erosion.evidence.inference.confounding import absorbed_by, ambiguity
from taichi_erosion.evidence.inference.cross_validation import ScoreGain
from taichi_erosion.evidence.inference.familywise_test import FamilywiseTest, power
from taichi_erosion.evidence.inference.goodness_of_fit import (
    chi_square,
    misfit_places,
    noise_table,
    rows_table,
)
from taichi_erosion.evidence.inference.intervals import parameter_fits, strength_fits, upper_strength
from taichi_erosion.evidence.inference.levels import ABSORBED, NOISE_LIMIT, PLAUSIBLE, TESTABLE_POWER
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion
from taichi_erosion.evidence.inference.model_discrepancy import free_residual
from taichi_erosion.evidence.inference.pipeline import Analysis, analyse
from taichi_erosion.evidence.inference.posterior import NONE, OUTSIDE, Posterior, label
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, prepare
from taichi_erosion.evidence.inference.refit import FittedHypothesis
from taichi_erosion.evidence.inference.residual_structure import residual_trends
from taichi_erosion.evidence.inference.screen import Signature
from taichi_erosion.evidence.inference.verdict import Decision


@dataclass(frozen=True)
class Remaining:
    """One candidate against what the final hypothesis leaves unexplained."""

    norm: float  # of its signature at expected strength, beyond calibration and named effects
    absorption: float
    best: float  # strength that would fit the rest best
    upper: float  # strength excluded with 95 %


def remaining(prepared: PreparedProblem, final: Expansion, signature: Signature) -> Remaining:
    """Signature projected on what neither calibration nor the named effects can imitate.

    What the model leaves unexplained beyond noise could hide an effect too: the noise is taken to be as large
    as the misfit per degree of freedom.
    """
    residual, basis = free_residual(prepared, final)
    freedom = prepared.rows.size - float(np.sum(basis[: prepared.rows.size] ** 2))
    excess = max(1.0, float(residual @ residual) / max(freedom, 1.0))
    whole = stack_signature(signature.raw.T, basis.shape[0] - prepared.rows.size, 0)
    free = (whole - basis @ (basis.T @ whole)).T
    at = int(np.argmin(np.abs(signature.grid - expected_strength(prepared.candidate(signature.name)))))
    kept = max(1.0 - signature.noise, 0.0) ** 0.5
    norm, size = float(np.linalg.norm(free[at])), float(np.linalg.norm(whole[:, at]))
    fall = 2.0 * free[:, : prepared.rows.size] @ residual - np.einsum("ij,ij->i", free, free)
    return Remaining(
        norm * kept / excess**0.5,
        1.0 - norm / size if size > 0.0 else 0.0,
        float(signature.grid[int(np.argmax(fall))]),
        upper_strength(signature.grid, 0.5 * fall / excess),
    )


@dataclass(frozen=True)
class Verdicts:
    """What all rows of the table share."""

    decision: Decision
    believed: Posterior
    seen: FamilywiseTest
    final: Expansion
    fitted: dict[str, Estimate]  # strengths of the final hypothesis and of the shortlist
    held_out: dict[str, ScoreGain]


def effect_table(
    prepared: PreparedProblem, signatures: tuple[Signature, ...], known: Verdicts
) -> dict[str, EffectFinding]:
    """One finding per candidate, in the study's order."""
    return {
        signature.name: effect_finding(prepared, signature, index, known)
        for index, signature in enumerate(signatures)
    }


def effect_finding(
    prepared: PreparedProblem, signature: Signature, index: int, known: Verdicts
) -> EffectFinding:
    """What is known about one candidate."""
    name, decision = signature.name, known.decision
    acts = name in known.final.fit.names
    rest = remaining(prepared, known.final, signature) if not acts else None
    norm = signature.norm if rest is None else rest.norm
    absorption = signature.absorption if rest is None else rest.absorption
    strong = power(norm, known.seen.threshold) if norm > 0.0 else 0.0
    status = status_of(name, decision, strong)
    strength = known.fitted.get(name) if status == "present" or name in decision.group or acts else None
    if strength is None:
        upper = rest.upper if rest is not None else nan
        strength = Estimate(rest.best if rest is not None else 0.0, 0.0, upper, False)
    held = known.held_out.get(name, ScoreGain(nan, nan))
    return EffectFinding(
        status=status,
        strength=strength.value,
        strength_low=strength.low,
        strength_high=strength.high,
        log_bayes_factor=known.believed.log_bayes.get(name, 0.0),
        power=strong,
        absorption=absorption,
        signature_norm=norm,
        probability=known.believed.inclusion.get(name, 0.0),
        p=float(known.seen.step_down[index]),
        held_out_gain=held.gain,
        held_out_error=held.error,
        sentence=effect_words(signature, status, strength, decision, absorption),
    )


def status_of(name: str, decision: Decision, strong: float) -> Status:
    """Present only what stands alone; silence means absence only where the effect would have been seen."""
    if name in decision.named:
        return "present"
    if name in decision.group or strong < TESTABLE_POWER:
        return "not_testable"
    return "excluded"


def effect_words(
    signature: Signature, status: Status, strength: Estimate, decision: Decision, absorption: float
) -> str:
    """One sentence about one candidate."""
    name = signature.name
    if status == "present":
        words = "consistent with the measurements at strength"
        return f"{name}: {words} {strength.value:.2g} ({strength.low:.2g} to {strength.high:.2g})"
    if name in decision.group:
        others = ", ".join(other for other in decision.group if other != name)
        return f"{name}: explains the misfit, but is not distinguished from {others}"
    if status == "excluded":
        return f"{name}: excluded above strength {strength.high:.2g}"
    if not np.any(signature.raw):
        return f"{name}: cannot act in any measured condition"
    if signature.noise > NOISE_LIMIT and signature.norm <= 1.0:
        return f"{name}: its signature is not resolved from the model's own scatter; more seeds would tell"
    if absorption > ABSORBED:
        share = f"{absorption:.0%} imitated"
        return f"{name}: hardly distinguishable from a change of the calibrated numbers ({share})"
    return f"{name}: not testable with these measurements"


MOST_SURVIVORS = 6
NO_CANDIDATE = "No candidate is listed, so nothing can be named; `compare` says where the model fails."


def discover(problem: Problem, seed: int, budget: Budget, progress: Progress) -> Discovery:
    """The whole autopsy; refuses to name anything when the noise is unknown."""
    start = perf_counter()
    problem = replace(problem, budget=budget)
    prepared = prepare(problem, problem.visible(), seed)
    if prepared.rows.size == 0 or not problem.candidates:
        return refused(problem, seed, progress, start)
    return discovery_of(analyse(prepared, seed, progress), seed, start)


def discovery_of(found: Analysis, seed: int, start: float) -> Discovery:
    """Every field of the discovery out of the autopsy."""
    prepared, base, final = found.prepared, found.base.scored.expansion, found.final.scored.expansion
    strengths = fitted_strengths(found)
    told = Verdicts(found.decision, found.believed, found.seen, final, strengths, found.held_out)
    effects = effect_table(prepared, found.found.signatures, told)
    where = found.where
    clues = residual_trends(prepared, base, where) if found.decision.verdict == "outside_library" else ()
    expected = {name: fitted.value for name, fitted in strengths.items()}
    return Discovery(
        verdict=found.decision.verdict,
        named=found.decision.named,
        group=found.decision.group,
        probabilities=found.believed.probability,
        effects=effects,
        parameters=parameter_fits(prepared, found.final.scored),
        where=where,
        chi2_before=chi_square(prepared, base),
        chi2_after=chi_square(prepared, final),
        n=prepared.rows.size,
        vault=VaultErrors(prepared.problem.vault.opened, nan, nan, nan),
        next_experiments=(),
        clues=clues,
        p=found.seen.p,
        p_misfit=found.p_misfit,
        p_misfit_after=found.p_misfit_after,
        decoy_rank=found.seen.decoy_rank,
        stability=found.stability,
        sentences=summary(found, effects, where, clues),
        warnings=(*prepared.warnings, *found.warnings, *bound_warnings(found)),
        noise=noise_table(prepared, found.found.seed_correlation),
        ambiguity=ambiguity(prepared, found.found, expected),
        absorbed_by=absorbed_by(prepared, found.found),
        survivors=plausible_hypotheses(found),
        closest=closest_hypotheses(found),
        rows_before=rows_table(prepared, base),
        rows_after=rows_table(prepared, final),
        failures=prepared.predictor.cost.failures,
        runs=prepared.predictor.cost.runs,
        wall_s=perf_counter() - start,
        seed=seed,
    )


def fitted_strengths(found: Analysis) -> dict[str, Estimate]:
    """Strengths of every refitted single, and of the final hypothesis where it has more than one effect."""
    strengths: dict[str, Estimate] = {}
    for item in found.judged:
        if len(item.names) == 1:
            strengths |= strength_fits(found.prepared, item.scored)
    return strengths | strength_fits(found.prepared, found.final.scored)


def plausible_hypothesis(found: Analysis, item: FittedHypothesis) -> PlausibleHypothesis:
    """One judged hypothesis as something that an experiment or a simulation can be about."""
    probability = found.believed.probability.get(label(item.names), 0.0)
    parameters, adopted = split_setting(found.prepared.axes, item.scored.expansion.fit.x)
    strengths = {**adopted, **item.scored.expansion.fit.acting()}
    return PlausibleHypothesis(item.names, probability, parameters, strengths)


def plausible_hypotheses(found: Analysis) -> tuple[PlausibleHypothesis, ...]:
    """Explanations that the next experiment has to tell apart."""
    survivors = [plausible_hypothesis(found, item) for item in [found.base, *found.judged]]
    survivors.sort(key=lambda survivor: -survivor.probability)
    kept = [s for k, s in enumerate(survivors) if k < 2 or s.probability > PLAUSIBLE]
    return tuple(kept[:MOST_SURVIVORS])


def closest_hypotheses(found: Analysis) -> tuple[PlausibleHypothesis, ...]:
    """The single effect and the pair that leave the least misfit, however unlikely."""
    sizes = [[item for item in found.judged if len(item.names) == count] for count in (1, 2)]
    return tuple(
        plausible_hypothesis(found, min(items, key=lambda item: item.scored.expansion.fit.misfit))
        for items in sizes
        if items
    )


def bound_warnings(found: Analysis) -> list[str]:
    """Calibrated numbers of the bare model that want to leave their range."""
    fits = parameter_fits(found.prepared, found.base.scored)
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
    prepared, base, known = calibrated_base(problem, seed, progress)
    nothing = {candidate.name: untested(candidate.name) for candidate in problem.candidates}
    share = 1.0 / (len(nothing) + 2)
    noise = noise_table(prepared, None, known)
    rows = rows_table(prepared, base.expansion)
    chi2 = chi_square(prepared, base.expansion) if known else nan
    return Discovery(
        verdict="not_testable",
        named=(),
        group=(),
        probabilities={NONE: share, OUTSIDE: share} | dict.fromkeys(nothing, share),
        effects=nothing,
        parameters=parameter_fits(prepared, base),
        where=misfit_places(prepared, base.expansion),
        chi2_before=chi2,
        chi2_after=chi2,
        n=prepared.rows.size,
        vault=VaultErrors(problem.vault.opened, nan, nan, nan),
        next_experiments=(),
        clues=(),
        p=1.0,
        p_misfit=nan,
        p_misfit_after=nan,
        decoy_rank=len(nothing) + 1,
        stability=1.0,
        sentences=noise.sentences if problem.candidates else (NO_CANDIDATE, *noise.sentences),
        warnings=prepared.warnings,
        noise=noise,
        ambiguity={},
        absorbed_by={},
        survivors=(),
        closest=(),
        rows_before=rows,
        rows_after=rows,
        failures=prepared.predictor.cost.failures,
        runs=prepared.predictor.cost.runs,
        wall_s=perf_counter() - start,
        seed=seed,
    )
