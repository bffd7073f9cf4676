"""Records of `compare`, `discover`, `adopt` and `next` on a problem: all condition the same race."""

from collections.abc import Sequence
from dataclasses import replace

from taichi_erosion.evidence.data.problem import Laboratory, Problem
from taichi_erosion.evidence.race.decision import Decision, decide
from taichi_erosion.evidence.race.dose_laws import law_of
from taichi_erosion.evidence.race.expansion import BudgetSpentError
from taichi_erosion.evidence.race.outlook import held_out_part
from taichi_erosion.evidence.race.posterior import Posterior, raced
from taichi_erosion.evidence.race.proposals import proposals
from taichi_erosion.evidence.race.record import LawPart, Record
from taichi_erosion.evidence.race.summary import summary, told_fit


def compare_record(problem: Problem, seed: int) -> Record:
    """Does the calibrated model agree? No candidate takes part."""
    return summary(raced(replace(problem, candidates=(), mechanisms=()), seed))


def discover_record(problem: Problem, seed: int) -> tuple[Record, Posterior]:
    """Which effect is missing, with the law of a mechanism or of a strength that varies."""
    posterior = raced(problem, seed)
    found = decide(posterior)
    return replace(summary(posterior, found), law=told_law(posterior, found)), posterior


def told_law(posterior: Posterior, found: Decision) -> LawPart | None:
    """The law of the doses of what is told; None where its strength is constant, or the budget is spent."""
    if not (found.named or found.mechanisms):
        return None
    try:
        return law_of(posterior.race, told_fit(posterior, found))
    except BudgetSpentError:
        return None


def adopt_record(problem: Problem, effects: Sequence[str], seed: int) -> Record:
    """The error of fitted and held-out rows with these effects."""
    posterior = raced(problem, seed)
    found = replace(decide(posterior), verdict="present", named=tuple(effects), group=(), mechanisms=())
    held = held_out_part(posterior, effects, seed)
    return replace(summary(posterior, found), held_out=held)


def next_record(problem: Problem, laboratory: Laboratory, seed: int) -> Record:
    """The measurements that would move the posterior."""
    posterior = raced(problem, seed)
    proposed = proposals(posterior, laboratory)
    return replace(summary(posterior), experiments=tuple(proposed.experiments))
