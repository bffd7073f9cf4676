"""Hypotheses weighed with other errors of the rows, or fewer rows: linear about their fits, or fitted again.

The best numbers and strengths t move then: in the linear expansion about the fit t_0 to t_1, and the misfit S
falls by

    F = S(t_0) - S_linear(t_1)

Where a hypothesis fits badly t_1 lies far away, and the fall in the model may differ from F. Half of the
excess of F over the same fall before the change is the most by which ln evidence can be too large. Where it
exceeds TRUSTED the model is evaluated at t_1, within its ranges. Where its misfit falls by F there, the
expansion moves there; where it does not, the hypothesis is fitted again, from the better of t_0 and t_1 and
from the prior, and scored. This is done for the likeliest in doubt, until none within BEHIND of the best is
left. Hypotheses farther behind keep their linear evidence, which may be too small too.
"""

from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Bools, Floats, expected_strength
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.map_fit import Objective, deviance, fit
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion, ScoredHypothesis
from taichi_erosion.evidence.inference.model_discrepancy import Kernels, discrepancy_gain
from taichi_erosion.evidence.inference.pipeline import FittedHypotheses
from taichi_erosion.evidence.inference.posterior import log_prior_of
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.refit import FittedHypothesis, scored_fit
from taichi_erosion.evidence.inference.robustness.error_accounts import (
    evidence_by_factor,
    stacked_fit,
    strength_scales,
)
from taichi_erosion.evidence.models.condition_errors import condition_errors

TRUSTED = 1.0  # ln evidence that a linear step may add, or by which the model may differ from it
BEHIND = 8.0  # ln evidence behind the best from which a hypothesis does not count, prior included


@dataclass(frozen=True)
class Change:
    """A change of the rows under all hypotheses."""

    before: PreparedProblem
    now: PreparedProblem
    kept: Bools  # (n,), rows before that remain
    family: Kernels  # of the rows that remain


@dataclass(frozen=True)
class LinearStep:
    """Step of a hypothesis to its best numbers and strengths after a change, linear about its fit."""

    start: Floats  # (p + k,), numbers and strengths at the fit
    end: Floats  # (p + k,), within their ranges
    fall: float  # of the misfit that it predicts


def reweighed(fitted: FittedHypotheses, prepared: PreparedProblem) -> FittedHypotheses:
    """All hypotheses with other variances or shared errors of the same rows."""
    family = fitted.family.rescaled(fitted.prepared.white, prepared.white)
    return changed(fitted, Change(fitted.prepared, prepared, np.ones(prepared.rows.size, np.bool_), family))


def without_rows(fitted: FittedHypotheses, gone: Bools) -> FittedHypotheses:
    """All hypotheses without some rows."""
    before, kept = fitted.prepared, ~gone
    now = shortened(before, kept)
    return changed(fitted, Change(before, now, kept, fitted.family.rescaled(before.white, now.white, kept)))


def shortened(prepared: PreparedProblem, kept: Bools) -> PreparedProblem:
    """Some of the rows; an error that only others share remains as a column of zeros."""
    rows = replace(prepared.rows.rows(kept), shared=prepared.rows.shared[kept])
    return replace(
        prepared,
        rows=rows,
        predictor=prepared.predictor.over(rows.observables, rows.which, rows.conditions),
        seed_variance=prepared.seed_variance[kept],
        variance=prepared.variance[kept],
        condition_errors=condition_errors(rows),
    )


def changed(fitted: FittedHypotheses, change: Change) -> FittedHypotheses:
    """All hypotheses after a change."""
    inclusion = fitted.posterior.inclusion
    found, old = list[FittedHypothesis](), [fitted.base, *fitted.refits]
    for item, evidence in zip(old, fitted.linear_evidence, strict=True):
        likely = not item.names or inclusion.get(item.names[0], 0.0) > levels.REPORTED_RIVAL
        rival = likely and len(item.names) < 2  # a remainder beside an unlikely effect is the one beside none
        found.append(linear(change, item, evidence, rival))
    base, *refits = trusted(change, old, found, max(len(fitted.screened.signatures), 1))
    return replace(fitted, prepared=change.now, base=base, refits=refits, family=change.family)


def linear(change: Change, item: FittedHypothesis, before: Floats, rival: bool) -> FittedHypothesis:
    """A hypothesis after a change, in its linear expansion; a rival has a remainder beside it.

    `before` is its ln evidence in that expansion before the change.
    """
    expansion = expansion_after(change, item.expansion)
    if not item.usable:
        return replace(item, scored=replace(item.scored, expansion=expansion))
    more = evidence_by_factor(change.now, expansion) - before
    scored = ScoredHypothesis(expansion, item.scored.likelihoods, item.scored.log_evidence + more)
    gain = np.full(item.gain.size, -np.inf)
    return FittedHypothesis(scored, discrepancy_gain(change.now, expansion, change.family) if rival else gain)


def expansion_after(change: Change, expansion: Expansion) -> Expansion:
    """The expansion over the rows that remain, with the errors that these share now."""
    kept, own = change.kept, expansion.shared[:, change.before.rows.shared.shape[1] :]
    return replace(
        expansion,
        mean=expansion.mean[kept],
        jacobian=expansion.jacobian[kept],
        paths=tuple(
            replace(
                path, runs=replace(path.runs, change=path.runs.change[:, kept]), change=path.change[:, kept]
            )
            for path in expansion.paths
        ),
        local=expansion.local[kept],
        shared=np.hstack([change.now.rows.shared, own[kept]]),
        moved=expansion.moved[kept],
    )


def trusted(
    change: Change, old: list[FittedHypothesis], found: list[FittedHypothesis], count: int
) -> list[FittedHypothesis]:
    """The same, every hypothesis that counts linear to within TRUSTED about its fit, or fitted again."""
    found, doubtful = list(found), dict[int, LinearStep]()
    for index, item in enumerate(found):
        if item.usable and (step := doubtful_step(change, old[index], item)) is not None:
            doubtful[index] = step
    while doubtful:
        worth = [weight(change.now, item, count) for item in found]
        top = max(doubtful, key=lambda index: worth[index])
        if worth[top] < max(worth) - BEHIND:
            break
        found[top] = settled(change, found[top], doubtful.pop(top))
    return found


def weight(prepared: PreparedProblem, item: FittedHypothesis, count: int) -> float:
    """Ln prior and evidence of a hypothesis among `count` candidates, with and without a remainder."""
    own, doubt = item.scored.log_evidence, prepared.doubt.log_weight
    parts = [log_prior_of(item.names, False, count) + doubt + own]
    if len(item.names) < 2:
        parts.append(log_prior_of(item.names, True, count) + doubt + own + item.gain)
    return float(log_sum_exp(np.concatenate(parts)))


def doubtful_step(change: Change, old: FittedHypothesis, item: FittedHypothesis) -> LinearStep | None:
    """The linear step of a hypothesis where it predicts more than TRUSTED beyond that before the change."""
    step = linear_step(change.now, item.expansion)
    if step.fall <= 2.0 * TRUSTED:
        return None
    more = step.fall - linear_step(change.before, old.expansion).fall
    return step if more > 2.0 * TRUSTED else None


def linear_step(prepared: PreparedProblem, expansion: Expansion) -> LinearStep:
    """The step to the best numbers and strengths of a linear expansion, shared errors at their best.

    Censored rows stand as ordinary ones in the fall of the misfit, as in the expansion.
    """
    part, below = stacked_fit(prepared, expansion)
    best, loose, count = expansion.fit, expansion.fit.psi.size, expansion.fit.x.size
    change = part.solve(below)[: loose + count]
    start, scales = np.concatenate([best.x, best.psi]), strength_scales(prepared, expansion)
    moved = np.concatenate([change[loose:], change[:loose] * scales])
    whole = Objective(prepared, best.names, prepared.seeds.scoring, best.beyond)
    work, free = prepared.working(expansion.mean), part.free(below)
    prior = below[work.residual.size : work.residual.size + loose + count]
    shared = prepared.whitening(work)(prepared.rows.shared)
    fixed = deviance(work.residual, shared, np.zeros(work.residual.size)) + float(prior @ prior)
    return LinearStep(start, np.clip(start + moved, whole.low, whole.high), fixed - float(free @ free))


def misfit(prepared: PreparedProblem, expansion: Expansion, mean: Floats, position: Floats) -> float:
    """Misfit of a mean at some numbers and strengths, prior included; infinite where the model fails."""
    residual = prepared.white(prepared.rows.z - mean)
    if not np.all(np.isfinite(residual)):
        return np.inf
    count, scales = position.size - expansion.fit.psi.size, strength_scales(prepared, expansion)
    prior = np.concatenate([position[:count], position[count:] / scales])
    return deviance(residual, prepared.white_shared, prepared.white_reach) + float(prior @ prior)


def settled(change: Change, item: FittedHypothesis, step: LinearStep) -> FittedHypothesis:
    """The hypothesis about where the step ends, if the model falls as predicted, else fitted again."""
    prepared, best, expansion = change.now, item.fit, item.expansion
    x, psi = np.split(step.end, [best.x.size])
    there = replace(best, x=x, psi=psi)
    mean = (
        change.before.predictor.mean(x, there.acting(), prepared.seeds.scoring)[change.kept] + expansion.moved
    )
    at_start = misfit(prepared, expansion, expansion.mean, step.start)
    at_end = misfit(prepared, expansion, mean, step.end)
    if abs(at_start - at_end - step.fall) < 2.0 * TRUSTED:
        return replace(item, scored=replace(item.scored, expansion=replace(expansion, fit=there, mean=mean)))
    expected = [expected_strength(prepared.candidate(name)) for name in best.names]
    starts = [step.end if at_end < at_start else step.start, np.append(prepared.prior_mean, expected)]
    again = fit(prepared, best.names, starts, beyond=best.beyond)
    found = scored_fit(prepared, again, change.family)
    return found if found.usable else item
