"""A discovery tested by fresh runs: what they say of it, and the runs to be made where they contradict it."""

from dataclasses import replace

from taichi_erosion.evidence.answers.discover import Answer, record_of
from taichi_erosion.evidence.answers.documents import discovery_sentences
from taichi_erosion.evidence.answers.rounds import FreshTest, refinement_point
from taichi_erosion.evidence.answers.words.fresh_runs import fresh_words
from taichi_erosion.evidence.data.problem import Progress
from taichi_erosion.evidence.data.transforms import split_setting
from taichi_erosion.evidence.emulator.design import RefinementPoint
from taichi_erosion.evidence.inference.pipeline import Analysis
from taichi_erosion.evidence.inference.robustness.fresh_check import (
    after_check,
    can_be_tested,
    contenders,
    fresh_check,
)


def tested(found: Answer, fresh: FreshTest, progress: Progress) -> tuple[Answer, frozenset[str]]:
    """An answer that names effects with the outcome of fresh runs, unstable where these contradict it.

    Beside it the keys of these runs.
    """
    if found.analysis is None or not can_be_tested(found.analysis):
        return found, frozenset()
    check, keys = fresh_check(found.analysis, fresh.simulator.simulate, progress)
    analysis, record = after_check(found.analysis, check), found.record
    if check.outcome == "contradicted":
        record = replace(record_of(analysis, found.beyond, record.seed), faults=record.faults)
        check = replace(check, more_runs=fresh.schedule(points_of(found.analysis)))
    units = analysis.fitted.prepared.problem.measurements.table_units
    check = replace(check, sentence=fresh_words(check, units))
    record = replace(record, stability=analysis.stability, fresh_runs=check)
    record = replace(record, sentences=discovery_sentences(record))
    return replace(found, record=record, analysis=analysis), keys


def points_of(found: Analysis) -> list[RefinementPoint]:
    """The explanations that were tested."""
    points = []
    for item in (found.final, *(each for each, _ in contenders(found))):
        parameters, adopted = split_setting(found.fitted.prepared.axes, item.fit.x)
        points.append(refinement_point(parameters, {**adopted, **item.fit.acting()}))
    return points
