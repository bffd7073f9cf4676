"""Faults of a set-up that its training runs show: runs that stopped, values that say nothing.

Told before every answer. A measure itself says what it lacks (`measures/shortfalls.py`); here its runs are
counted, and a heap that is too small is told beside the measured angles.
"""

from collections.abc import Iterator, Sequence
from math import nan
from statistics import median
from typing import Any

import numpy as np

from taichi_erosion.campaign.request import RunResult
from taichi_erosion.evidence.data.problem import Floats, SetUpFault
from taichi_erosion.evidence.emulator.design import StudyScene, TrainingRun
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.evidence.models.simulator import value_in_unit
from taichi_erosion.measures import shortfalls

Trained = Sequence[tuple[TrainingRun, RunResult]]
SIZE_FLAGS = ("small_heap", "growing_angle")  # no fault where the laboratory's heap is as small
COMMON = 0.5  # share of the runs from which a fault is one of the set-up [1]


def run_faults(study: Study, scene: StudyScene, trained: Trained) -> Iterator[SetUpFault]:
    """Faults that the runs of one scene show, those of the bare model where there are any."""
    yield from stopped_runs(scene, [result for _, result in trained])
    bare = [result for run, result in trained if not run.effects] or [result for _, result in trained]
    ended = [result for result in bare if not result.failure]
    for name in scene.observables:
        yield from measure_faults(study, scene, name, ended)


def stopped_runs(scene: StudyScene, results: Sequence[RunResult]) -> Iterator[SetUpFault]:
    """Runs that gave no result."""
    failures = [result.failure for result in results if result.failure]
    if failures:
        name, count = scene.measure.scene.name, f"{len(failures)} of {len(results)}"
        words = f"{name}: {count} runs stopped and are left out; the first: {failures[0]}"
        yield SetUpFault("failed_runs", name, words, len(failures) > COMMON * len(results))


def measure_faults(
    study: Study, scene: StudyScene, name: str, ended: Sequence[RunResult]
) -> Iterator[SetUpFault]:
    """What most runs lack for one observable, or why most have no value."""
    measure = scene.simulator.measures[name]
    records = [result.record.get("measures", {}).get(measure.measure, {}) for result in ended]
    by_flag: dict[str, list[Any]] = {}
    for each in (each for record in records for each in record.get("shortfalls", ())):
        by_flag.setdefault(each["flag"], []).append(each)
    common = {flag: found for flag, found in by_flag.items() if len(found) >= COMMON * len(records)}
    values = np.array([value_in_unit(result, measure) for result in ended])
    for flag, found in common.items():
        if flag not in SIZE_FLAGS or not study.file.observables[name].same_size:
            yield shortfall_fault(study, scene, name, found, values)
    missing = int(np.sum(~np.isfinite(values)))
    if missing > COMMON * len(records) and not any(each["blocks"] for f in common.values() for each in f):
        reasons = [
            note for record in records if record.get("value") is None for note in record.get("notes", ())
        ]
        why = f"; the first: {reasons[0]}" if reasons else ""
        yield SetUpFault(
            "no_value", name, f"{name}: {missing} of {len(records)} runs have no value{why}", True
        )


def shortfall_fault(
    study: Study, scene: StudyScene, name: str, found: Sequence[Any], values: Floats
) -> SetUpFault:
    """A common shortfall in the words of the run in the middle; a small heap beside the measured angles."""
    middle = sorted(found, key=lambda each: each["found"])[(len(found) - 1) // 2]
    sentence, blocks = f"{name}: {middle['sentence']}", bool(middle["blocks"])
    if middle["flag"] == "small_heap":
        sentence = f"{name}: {small_heap_words(study, scene, name, values, middle['found'])}"
    return SetUpFault("too_small" if blocks else "not_converged", name, sentence, blocks)


def small_heap_words(study: Study, scene: StudyScene, name: str, values: Floats, rows: float) -> str:
    """Simulated and measured angles, and how many grains are enough for the flattest measured one.

    `rows`: of grains on the flank of the simulated heap.
    """
    table, measure = study.problem.visible(), scene.simulator.measures[name]
    chosen = np.array([each == name for each in table.observable]) & ~table.censored
    wanted, got = table.value[chosen], values[np.isfinite(values)]
    flattest = float(wanted.min()) if wanted.size and measure.unit == "deg" else nan
    grains = scene.simulator.scene(measure.scene, ()).grains.count
    simulated = f"{median(got):.3g} {measure.unit} simulated" if got.size else "no angle simulated"
    return (
        f"the heap is too small for an angle: {simulated} against {interval(wanted)} measured, "
        f"{shortfalls.small_heap_advice(rows, grains, flattest)}"
    )


def interval(values: Floats) -> str:
    """Least and largest of some values."""
    if not values.size:
        return "none"
    low, high = f"{values.min():.3g}", f"{values.max():.3g}"
    return low if low == high else f"{low} to {high}"
