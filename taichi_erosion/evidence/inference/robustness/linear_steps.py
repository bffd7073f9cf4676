"""Evidence of a hypothesis after its errors or rows have changed: linear about its fit, or fitted again.

The best numbers and strengths t move then: in the linear expansion about the fit t_0 to t_1, and the misfit S
falls by

    F = S(t_0) - S_linear(t_1)

Where a hypothesis fits badly t_1 lies far away, and the fall in the model may differ from F. Half of the
excess of F over the same fall before the change is the most by which ln evidence can be too large. Where it
exceeds TRUSTED the model is evaluated at t_1, within its ranges. Where its misfit falls by F there, the
expansion moves there; where it does not, the hypothesis is fitted again, from t_1, from t_0 and from the
prior.

Hypotheses weighed with other errors of the rows, or fewer rows.

Linear about their fits; the likeliest whose linear step is in doubt is fitted again,
until none in doubt within BEHIND of the best is left. Hypotheses farther behind keep their linear evidence.

Sets of levels that may be off while the others are not, weighed from the fit with all of them free.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import Projection, log_sum_exp, projection
from taichi_erosion.evidence.data.problem import Bools, Floats, expected_strength
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.map_fit import Fit, Objective, deviance, fit
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion, ScoredHypothesis
from taichi_erosion.evidence.inference.model_discrepancy import Kernels, discrepancy_gain
from taichi_erosion.evidence.inference.pipeline import FittedHypotheses
from taichi_erosion.evidence.inference.posterior import log_prior_of
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.refit import FittedHypothesis, scored_fit
from taichi_erosion.evidence.models.condition_errors import condition_errors

TRUSTED = 1.0  # ln evidence that a linear step may add, or by which the model may differ from it
BEHIND = 8.0  # ln evidence behind the best from which a hypothesis does not count, prior included
MOST_LEVELS = 6  # observables whose sets of free levels are all tried


@dataclass(frozen=True)
class LinearStep:
    """Step of a hypothesis to its best numbers and strengths after a change, linear about its fit."""

    start: Floats  # (p + k,), numbers and strengths at the fit
    end: Floats  # (p + k,), within their ranges
    fall: float  # of the misfit that it predicts


def linear_evidence(prepared: PreparedProblem, expansion: Expansion) -> float:
    """Ln marginal likelihood of a hypothesis about its best fit, averaged over the noise factors."""
    return prepared.doubt.averaged(evidence_by_factor(prepared, expansion))


def evidence_by_factor(prepared: PreparedProblem, expansion: Expansion) -> Floats:
    """The same at every noise factor f, linear in the calibrated numbers and strengths.

        ln Z = -sum ln(f s_i) - |M e+|^2 / 2 f^2 - 1/2 ln |D^T D|

    The noise factor f scales rows and prior alike. Censored rows stand as ordinary ones in their weights.
    """
    part, below = stacked_fit(prepared, expansion)
    free, plain = part.free(below), ~prepared.rows.censored
    misfit, factor = float(free @ free), prepared.doubt.factor
    volume = float(np.sum(np.log(prepared.sd[plain]))) + prepared.log_correlation + 0.5 * part.log_determinant
    return -plain.sum() * np.log(factor) - 0.5 * misfit / factor**2 - volume


def stacked_fit(prepared: PreparedProblem, expansion: Expansion) -> tuple[Projection, Floats]:
    """Columns D of strengths, in units of their prior, of numbers and of shared errors; e+ at the fit."""
    fit, rows = expansion.fit, prepared.rows
    scales = strength_scales(prepared, expansion)
    work = prepared.working(expansion.mean)
    white = prepared.whitening(work)
    columns = white(np.hstack([expansion.local * scales, expansion.jacobian]))
    start = np.concatenate([fit.psi / scales, fit.x])
    below = np.concatenate([work.residual, -start, np.zeros(rows.shared.shape[1])])
    return projection(columns, white(rows.shared)), below


def strength_scales(prepared: PreparedProblem, expansion: Expansion) -> Floats:
    """Prior scale of every strength of a hypothesis."""
    return np.array([max(prepared.candidate(name).prior_scale, 1e-9) for name in expansion.fit.names])


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


def doubtful_step(
    before: PreparedProblem, old: Expansion, now: PreparedProblem, expansion: Expansion
) -> LinearStep | None:
    """The linear step of a hypothesis where it predicts more than TRUSTED beyond that before the change."""
    step = linear_step(now, expansion)
    if step.fall <= 2.0 * TRUSTED:
        return None
    return step if step.fall - linear_step(before, old).fall > 2.0 * TRUSTED else None


def settled(
    prepared: PreparedProblem, expansion: Expansion, step: LinearStep, mean: Callable[[Fit], Floats]
) -> Expansion | Fit:
    """The expansion about where the step ends, if the model falls as predicted; else another fit.

    `mean` evaluates the model over the rows of the expansion.
    """
    x, psi = np.split(step.end, [expansion.fit.x.size])
    there = replace(expansion.fit, x=x, psi=psi)
    moved = mean(there) + expansion.moved
    at_start = misfit(prepared, expansion, expansion.mean, step.start)
    at_end = misfit(prepared, expansion, moved, step.end)
    if abs(at_start - at_end - step.fall) < 2.0 * TRUSTED:
        return replace(expansion, fit=there, mean=moved)
    expected = [expected_strength(prepared.candidate(name)) for name in there.names]
    starts = [step.end, step.start, np.append(prepared.prior_mean, expected)]
    return fit(prepared, there.names, starts, beyond=there.beyond)


def level_sets(count: int) -> tuple[list[list[int]], Floats]:
    """Sets of levels that may be off while the others are 0, never none of them, and ln of their priors.

    Of many observables only single ones, pairs, and all of them at once.
    """
    sizes = range(1, count + 1) if count <= MOST_LEVELS else (1, 2, count)
    sets = [list(chosen) for size in sizes for chosen in combinations(range(count), size)]
    each = levels.PRIOR_LEVEL_EACH
    log_prior = np.array([len(c) * np.log(each) + (count - len(c)) * np.log1p(-each) for c in sets])
    return sets, log_prior - log_sum_exp(log_prior)


def log_level_sets(best: Floats, covariance: Floats) -> Floats:
    """Ln evidence (sets, columns) with only some levels off over that with all of them free, priors included.

        Z(S) / Z(all) = N(0; mu, C) / N(0; 0, 1)    over the levels that are not in S

    Reference: Dickey (1971), Ann. Math. Stat. 42, 204.
    """
    sets, log_prior = level_sets(best.shape[0])
    found = np.repeat(log_prior[:, np.newaxis], best.shape[1], axis=1)
    for row, chosen in enumerate(sets):
        rest = [k for k in range(best.shape[0]) if k not in chosen]
        if rest:
            part, mean = covariance[..., rest, :][..., rest], best[rest].T
            solved = (np.linalg.inv(part) @ mean[:, :, np.newaxis])[..., 0]
            squares = np.einsum("ci,ci->c", mean, solved)
            found[row] -= 0.5 * (squares + np.linalg.slogdet(part)[1])
    return found


def log_level_share(best: Floats, covariance: Floats) -> Floats:
    """Ln evidence (columns,) averaged over the sets of levels that may be off, over that with all free."""
    return log_sum_exp(log_level_sets(best, covariance), axis=0)


@dataclass(frozen=True)
class Change:
    """A change of the rows under all hypotheses."""

    before: PreparedProblem
    now: PreparedProblem
    kept: Bools  # (n,), rows before that remain
    family: Kernels  # of the rows that remain


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
        if item.usable and (step := doubt(change, old[index], item)) is not None:
            doubtful[index] = step
    while doubtful:
        worth = [weight(change.now, item, count) for item in found]
        top = max(doubtful, key=lambda index: worth[index])
        if worth[top] < max(worth) - BEHIND:
            break
        found[top] = weighed_again(change, found[top], doubtful.pop(top))
    return found


def weight(prepared: PreparedProblem, item: FittedHypothesis, count: int) -> float:
    """Ln prior and evidence of a hypothesis among `count` candidates, with and without a remainder."""
    own, doubt = item.scored.log_evidence, prepared.doubt.log_weight
    parts = [log_prior_of(item.names, False, count) + doubt + own]
    if len(item.names) < 2:
        parts.append(log_prior_of(item.names, True, count) + doubt + own + item.gain)
    return float(log_sum_exp(np.concatenate(parts)))


def doubt(change: Change, old: FittedHypothesis, item: FittedHypothesis) -> LinearStep | None:
    """The linear step of a hypothesis where it is in doubt."""
    return doubtful_step(change.before, old.expansion, change.now, item.expansion)


def weighed_again(change: Change, item: FittedHypothesis, step: LinearStep) -> FittedHypothesis:
    """The hypothesis about where the step ends, if the model falls as predicted, else fitted again."""
    prepared = change.now

    def mean(there: Fit) -> Floats:
        whole = change.before.predictor.mean(there.x, there.acting(), prepared.seeds.scoring)
        return whole[change.kept]

    found = settled(prepared, item.expansion, step, mean)
    if isinstance(found, Expansion):
        return replace(item, scored=replace(item.scored, expansion=found))
    again = scored_fit(prepared, found, change.family)
    return again if again.usable else item
