"""All stages of one examination, in order: calibrate, sign, screen, refit, weigh, decide."""

from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.data.findings import MisfitPlace
from taichi_erosion.evidence.data.problem import Floats, Progress
from taichi_erosion.evidence.inference.cross_validation import ScoreGain, held_out
from taichi_erosion.evidence.inference.familywise_test import DRAWS, FamilywiseTest, familywise_test, power
from taichi_erosion.evidence.inference.goodness_of_fit import misfit_p, misfit_places, residuals_of
from taichi_erosion.evidence.inference.levels import UNSTABLE
from taichi_erosion.evidence.inference.map_fit import Fit, fit_base
from taichi_erosion.evidence.inference.marginal_likelihood import expand, score
from taichi_erosion.evidence.inference.model_discrepancy import Kernel, discrepancy_gain, kernels
from taichi_erosion.evidence.inference.pairs import fit_pairs
from taichi_erosion.evidence.inference.posterior import Posterior, label, posterior
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.refit import FittedHypothesis, chosen_singles, fit_singles, hypotheses
from taichi_erosion.evidence.inference.screen import Screen, screen
from taichi_erosion.evidence.inference.verdict import Decision, adequate_decision, best_hypothesis, decide
from taichi_erosion.evidence.models.predictor import seed_mean

ROUGH_DRAWS = 200  # of a null that only ranks


@dataclass(frozen=True)
class Analysis:
    """Everything that the stages found, before it is put into words."""

    prepared: PreparedProblem
    base: FittedHypothesis
    found: Screen
    seen: FamilywiseTest
    judged: list[FittedHypothesis]
    believed: Posterior
    decision: Decision
    final: FittedHypothesis  # the hypothesis whose calibration is reported
    p_misfit: float
    p_misfit_after: float  # of what the final hypothesis leaves
    where: tuple[MisfitPlace, ...]  # the bare model fails, worst first
    family: list[Kernel]
    held_out: dict[str, ScoreGain]
    stability: float
    warnings: tuple[str, ...]


def analyse(prepared: PreparedProblem, seed: int, progress: Progress) -> Analysis:
    """All stages of one examination."""
    progress("calibrating the bare model", 0.05)
    prepared, fitted, warnings = fit_base(prepared)
    expansion = expand(prepared, fitted)
    family = kernels(prepared)
    base = FittedHypothesis((), score(prepared, expansion), discrepancy_gain(prepared, expansion, family))
    progress("making signatures", 0.15)
    found = screen(prepared, expansion)
    p_misfit, where = misfit_p(residuals_of(prepared, expansion)), misfit_places(prepared, expansion)
    rough = familywise_test(prepared, found, np.ones(ROUGH_DRAWS), seed)
    judged = fit_singles(prepared, found, chosen_singles(prepared, found, rough), family, progress)
    judged += fit_pairs(prepared, found, judged, family, progress)
    progress("weighing the evidence", 0.9)
    believed = posterior(prepared, hypotheses(prepared, base, found, rough, judged))
    seen = familywise_test(prepared, found, noise_draws(prepared, believed, seed), seed)
    least = min([p_misfit, *(place.p for place in where)])
    decision = initial_decision(prepared, found, judged, believed, seen, least)
    gains = {item.names[0]: held_out(prepared, expansion, item.scored.expansion) for item in usable(judged)}
    stability, decision = seed_stability(prepared, base, found, rough, judged, family, decision)
    decision, final, left = final_decision(prepared, base, judged, believed, decision)
    return Analysis(
        prepared,
        base,
        found,
        seen,
        judged,
        believed,
        decision,
        final,
        p_misfit,
        left,
        where,
        family,
        gains,
        stability,
        tuple(warnings),
    )


def initial_decision(
    prepared: PreparedProblem,
    found: Screen,
    judged: list[FittedHypothesis],
    believed: Posterior,
    seen: FamilywiseTest,
    p_misfit: float,
) -> Decision:
    """The first verdict; none where almost anything would explain the rows."""
    powers = [power(signature.norm, seen.threshold) for signature in found.signatures]
    if too_few_rows(prepared):
        return Decision("not_testable", (), ())
    return decide(believed, judged, seen.p, p_misfit, powers)


def final_decision(
    prepared: PreparedProblem,
    base: FittedHypothesis,
    judged: list[FittedHypothesis],
    believed: Posterior,
    decision: Decision,
) -> tuple[Decision, FittedHypothesis, float]:
    """The verdict, the hypothesis whose calibration is reported, and the chance of what that leaves."""
    names = best_hypothesis(believed, judged, decision)
    final = next((item for item in judged if item.names == names), base)
    left = misfit_p(residuals_of(prepared, final.scored.expansion))
    kept = adequate_decision(decision, believed, left)
    if kept != decision:
        return final_decision(prepared, base, judged, believed, kept)
    return decision, final, left


def too_few_rows(prepared: PreparedProblem) -> bool:
    """Whether there are no more rows than calibrated numbers: almost anything would explain them."""
    return prepared.rows.size <= len(prepared.axes)


def usable(judged: list[FittedHypothesis]) -> list[FittedHypothesis]:
    """Singles at whose best fit the model works."""
    return [item for item in judged if len(item.names) == 1 and item.scored.likelihoods]


def noise_draws(prepared: PreparedProblem, believed: Posterior, seed: int) -> Floats:
    """Noise factors as the posterior has them."""
    weight = believed.noise_weight / believed.noise_weight.sum()
    return np.random.default_rng(seed + 1).choice(prepared.doubt.factor, size=DRAWS, p=weight)


def seed_stability(
    prepared: PreparedProblem,
    base: FittedHypothesis,
    found: Screen,
    rough: FamilywiseTest,
    judged: list[FittedHypothesis],
    family: list[Kernel],
    decision: Decision,
) -> tuple[float, Decision]:
    """Share of the two halves of the judging seeds that agree on the name, and the verdict after that.

    A half that is more than even on another name makes the verdict unstable.
    """
    if not prepared.noisy or decision.verdict not in ("present", "group"):
        return 1.0, decision
    accepted = {*decision.named, *decision.group}
    half, agree, against = prepared.seeds.scoring.size // 2, 0, 0
    for seeds in (prepared.seeds.scoring[:half], prepared.seeds.scoring[half:]):
        part = replace(
            prepared,
            seeds=replace(prepared.seeds, scoring=seeds),
            variance=prepared.rows.variance + prepared.seed_variance / seeds.size,
        )
        halves = [rescored(part, item, family) for item in judged]
        believed = posterior(part, hypotheses(part, rescored(part, base, family), found, rough, halves))
        top = max(believed.probability, key=lambda key: believed.probability[key])
        agree += bool(accepted & set(top.split("+")))
        against += (
            top != label(()) and not accepted & set(top.split("+")) and believed.probability[top] > UNSTABLE
        )
    return agree / 2.0, replace(decision, verdict="unstable") if against else decision


def rescored(prepared: PreparedProblem, item: FittedHypothesis, family: list[Kernel]) -> FittedHypothesis:
    """The same hypothesis weighed with other judging seeds, out of runs that were made already."""
    expansion = replace(item.scored.expansion, mean=part_mean(prepared, item.scored.expansion.fit))
    return replace(
        item, scored=score(prepared, expansion), gain=discrepancy_gain(prepared, expansion, family)
    )


def part_mean(prepared: PreparedProblem, fit: Fit) -> Floats:
    """Mean over some of the judging seeds."""
    for (x, acting, seeds), values in prepared.predictor.seen.items():
        drawn = np.frombuffer(seeds, dtype=np.int64)
        same = x == fit.x.tobytes() and dict(acting) == fit.acting()
        if same and np.isin(prepared.seeds.scoring, drawn).all():
            return seed_mean(values[np.isin(drawn, prepared.seeds.scoring)])
    return prepared.predictor.mean(fit.x, fit.acting(), prepared.seeds.scoring)
