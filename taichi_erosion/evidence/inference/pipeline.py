"""All stages of one examination, in order: calibrate, sign, screen, refit, weigh, decide."""

from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.data.findings import Where
from taichi_erosion.evidence.data.problem import Floats, Progress
from taichi_erosion.evidence.inference.cross_validation import HeldOut, held_out
from taichi_erosion.evidence.inference.familywise_test import DRAWS, Significance, power, significance
from taichi_erosion.evidence.inference.goodness_of_fit import misfit_p, residuals_of, where_it_fails
from taichi_erosion.evidence.inference.levels import UNSTABLE
from taichi_erosion.evidence.inference.map_fit import Fit, fit_base
from taichi_erosion.evidence.inference.marginal_likelihood import expand, score
from taichi_erosion.evidence.inference.model_discrepancy import Kernel, discrepancy_gain, kernels
from taichi_erosion.evidence.inference.pairs import judge_pairs
from taichi_erosion.evidence.inference.posterior import Posterior, label, posterior
from taichi_erosion.evidence.inference.prepared_problem import Examination
from taichi_erosion.evidence.inference.refit import Judged, chosen_singles, hypotheses, judge_singles
from taichi_erosion.evidence.inference.screen import Screen, screen
from taichi_erosion.evidence.inference.verdict import Decision, best_hypothesis, borne_out, decide
from taichi_erosion.evidence.models.predictor import seed_mean

ROUGH_DRAWS = 200  # of a null that only ranks


@dataclass(frozen=True)
class Autopsy:
    """Everything that the stages found, before it is put into words."""

    exam: Examination
    base: Judged
    found: Screen
    seen: Significance
    judged: list[Judged]
    believed: Posterior
    decision: Decision
    final: Judged  # the hypothesis whose calibration is reported
    p_misfit: float
    p_misfit_after: float  # of what the final hypothesis leaves
    where: tuple[Where, ...]  # the bare model fails, worst first
    family: list[Kernel]
    held_out: dict[str, HeldOut]
    stability: float
    warnings: tuple[str, ...]


def autopsy(exam: Examination, seed: int, progress: Progress) -> Autopsy:
    """All stages of one examination."""
    progress("calibrating the bare model", 0.05)
    exam, fitted, warnings = fit_base(exam)
    expansion = expand(exam, fitted)
    family = kernels(exam)
    base = Judged((), score(exam, expansion), discrepancy_gain(exam, expansion, family))
    progress("making signatures", 0.15)
    found = screen(exam, expansion)
    p_misfit, where = misfit_p(residuals_of(exam, expansion)), where_it_fails(exam, expansion)
    rough = significance(exam, found, np.ones(ROUGH_DRAWS), seed)
    judged = judge_singles(exam, found, chosen_singles(exam, found, rough), family, progress)
    judged += judge_pairs(exam, found, judged, family, progress)
    progress("weighing the evidence", 0.9)
    believed = posterior(exam, hypotheses(exam, base, found, rough, judged))
    seen = significance(exam, found, noise_draws(exam, believed, seed), seed)
    least = min([p_misfit, *(place.p for place in where)])
    decision = decided(exam, found, judged, believed, seen, least)
    gains = {item.names[0]: held_out(exam, expansion, item.scored.expansion) for item in usable(judged)}
    stability, decision = settled(exam, base, found, rough, judged, family, decision)
    decision, final, left = concluded(exam, base, judged, believed, decision)
    return Autopsy(
        exam,
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


def decided(
    exam: Examination,
    found: Screen,
    judged: list[Judged],
    believed: Posterior,
    seen: Significance,
    p_misfit: float,
) -> Decision:
    """The first verdict; none where almost anything would explain the rows."""
    powers = [power(signature.norm, seen.threshold) for signature in found.signatures]
    if too_few_rows(exam):
        return Decision("not_testable", (), ())
    return decide(believed, judged, seen.p, p_misfit, powers)


def concluded(
    exam: Examination, base: Judged, judged: list[Judged], believed: Posterior, decision: Decision
) -> tuple[Decision, Judged, float]:
    """The verdict, the hypothesis whose calibration is reported, and the chance of what that leaves."""
    names = best_hypothesis(believed, judged, decision)
    final = next((item for item in judged if item.names == names), base)
    left = misfit_p(residuals_of(exam, final.scored.expansion))
    kept = borne_out(decision, believed, left)
    if kept != decision:
        return concluded(exam, base, judged, believed, kept)
    return decision, final, left


def too_few_rows(exam: Examination) -> bool:
    """Whether there are no more rows than calibrated numbers: almost anything would explain them."""
    return exam.rows.size <= len(exam.axes)


def usable(judged: list[Judged]) -> list[Judged]:
    """Singles at whose best fit the model works."""
    return [item for item in judged if len(item.names) == 1 and item.scored.surfaces]


def noise_draws(exam: Examination, believed: Posterior, seed: int) -> Floats:
    """Noise factors as the posterior has them."""
    weight = believed.noise_weight / believed.noise_weight.sum()
    return np.random.default_rng(seed + 1).choice(exam.doubt.factor, size=DRAWS, p=weight)


def settled(
    exam: Examination,
    base: Judged,
    found: Screen,
    rough: Significance,
    judged: list[Judged],
    family: list[Kernel],
    decision: Decision,
) -> tuple[float, Decision]:
    """Share of the two halves of the judging seeds that agree on the name, and the verdict after that.

    A half that is more than even on another name makes the verdict unstable.
    """
    if not exam.noisy or decision.verdict not in ("present", "group"):
        return 1.0, decision
    accepted = {*decision.named, *decision.group}
    half, agree, against = exam.seeds.judging.size // 2, 0, 0
    for seeds in (exam.seeds.judging[:half], exam.seeds.judging[half:]):
        part = replace(
            exam,
            seeds=replace(exam.seeds, judging=seeds),
            variance=exam.rows.variance + exam.seed_variance / seeds.size,
        )
        halves = [rejudged(part, item, family) for item in judged]
        believed = posterior(part, hypotheses(part, rejudged(part, base, family), found, rough, halves))
        top = max(believed.probability, key=lambda key: believed.probability[key])
        agree += bool(accepted & set(top.split("+")))
        against += (
            top != label(()) and not accepted & set(top.split("+")) and believed.probability[top] > UNSTABLE
        )
    return agree / 2.0, replace(decision, verdict="unstable") if against else decision


def rejudged(exam: Examination, item: Judged, family: list[Kernel]) -> Judged:
    """The same hypothesis weighed with other judging seeds, out of runs that were made already."""
    expansion = replace(item.scored.expansion, mean=part_mean(exam, item.scored.expansion.fit))
    return replace(item, scored=score(exam, expansion), gain=discrepancy_gain(exam, expansion, family))


def part_mean(exam: Examination, fit: Fit) -> Floats:
    """Mean over some of the judging seeds."""
    for (x, acting, seeds), values in exam.predictor.seen.items():
        drawn = np.frombuffer(seeds, dtype=np.int64)
        same = x == fit.x.tobytes() and dict(acting) == fit.acting()
        if same and np.isin(exam.seeds.judging, drawn).all():
            return seed_mean(values[np.isin(drawn, exam.seeds.judging)])
    return exam.predictor.mean(fit.x, fit.acting(), exam.seeds.judging)
