"""Hypotheses weighed with other errors of the rows, or fewer rows.

Linear about their fits (`linear_steps.py`); the likeliest whose linear step is in doubt is fitted again,
until none in doubt within BEHIND of the best is left. Hypotheses farther behind keep their linear evidence.
"""

from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Bools, Floats
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.map_fit import Fit
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion, ScoredHypothesis
from taichi_erosion.evidence.inference.model_discrepancy import Kernels, discrepancy_gain
from taichi_erosion.evidence.inference.pipeline import FittedHypotheses
from taichi_erosion.evidence.inference.posterior import log_prior_of
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.refit import FittedHypothesis, scored_fit
from taichi_erosion.evidence.inference.robustness.linear_steps import (
    BEHIND,
    LinearStep,
    doubtful_step,
    evidence_by_factor,
    settled,
)
from taichi_erosion.evidence.models.condition_errors import condition_errors


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
