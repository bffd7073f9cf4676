"""The set-up before physics: what has to be right before a misfit says anything about missing effects.

Faults of runs come from `emulator/training_runs.py`. Where a fault blocks, nothing is named.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from taichi_erosion.campaign.study_file import StudyFile
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.comparison_rows import comparison_rows, condition_groups
from taichi_erosion.evidence.data.held_out_rows import SPARE, distinct_row_count
from taichi_erosion.evidence.data.problem import Problem, SetUpFault
from taichi_erosion.evidence.data.transforms import from_scale
from taichi_erosion.evidence.models.load_study import Study, first_study_of_adoptions
from taichi_erosion.evidence.race.fit import Race
from taichi_erosion.evidence.race.priors import FAMILYWISE
from taichi_erosion.evidence.words.part_words import FAULTS, UNLIKE, row_list, unit_mistake_text
from taichi_erosion.evidence.words.vocabulary import in_words, join_words
from taichi_erosion.execution.observables import why_heap_is_too_small
from taichi_erosion.scene.schema.units import conversion_factor, parse_unit
from taichi_erosion.tables.number_words import plain
from taichi_erosion.tables.spreadsheet import laboratory_table_digest

FAR_OFF = 8.0  # factor from the model, typical row, that no effect makes


def blocks_verdict(faults: Sequence[SetUpFault]) -> bool:
    return any(fault.blocks for fault in faults)


def stale_faults(study_path: Path, file: StudyFile) -> Iterator[SetUpFault]:
    """The laboratory's table, where it has changed since the study was made of it.

    `study new` corrects the table that adopted studies share, and writes its digest into the first of them.
    """
    path, first = first_study_of_adoptions(study_path, file)
    same = first.study.measurements == file.study.measurements and path.parent == study_path.parent
    head = first.study if same else file.study
    source = study_path.parent / (head.made_from or "")
    if source.is_file() and laboratory_table_digest(source) != head.made_from_digest:
        yield SetUpFault("source_changed", "table", FAULTS["source_changed"].format(source.name), False)


def refuse_unknown_scatter(study: Study) -> None:
    """Raises BadInput for a table of which no misfit can be judged."""
    if comparison_rows(study.problem, study.problem.visible_rows()).has_noise.any():
        return
    table, columns = study.problem.measurements, study.problem.measurements.conditions
    rest = {name: {k: x for k, x in columns.items() if k != name} for name in columns}
    sets = {name: np.unique(condition_groups(replace(table, conditions=rest[name]))) for name in columns}
    names = [name for name, numbers in sets.items() if 2 * numbers.size <= table.size]
    names = names if len(names) == 1 else [name for name in names if name in study.problem.unread]
    names = [name for name in names if np.all(columns[name] != 0.0)]  # of a dose some have none
    hint = FAULTS["repeated_but_for"] * (0 < len(names) < len(columns))
    alike = join_words((f"'{name.rpartition('.')[2]}'" for name in names), "or")
    words = f"{FAULTS['unknown_scatter']}{hint}".format(alike)
    raise BadInput(f"{study.file.study.measurements}: {words}")


def refuse_blocking(study: Study, needs_rows: bool) -> None:
    """Raises BadInput for faults that keep an answer of scenes waiting, before its runs are spent."""
    faults = (*(study.faults if needs_rows else ()), *small_heap_faults(study))
    lines = [f"{study.path}: {each.sentence}; --force goes on" for each in faults if each.blocks]
    if lines and not study.options.force:
        raise BadInput(*lines)


def small_heap_faults(study: Study) -> Iterator[SetUpFault]:
    """Heaps of too few grains for every angle of the table."""
    table, simulator = study.problem.measurements, study.simulator
    assert simulator is not None
    for name, measure in simulator.measures.items():
        factor = conversion_factor(parse_unit(measure.unit), parse_unit("deg")) or 1.0
        angles = factor * table.value[np.array(table.observable) == name]
        words = why_heap_is_too_small(simulator.load_scene_at(measure.scene), measure.measure, angles)
        if words and not study.file.observables[name].same_size:
            yield SetUpFault("too_small", name, f"{name}: {words}", True)


def unit_faults(race: Race) -> Iterator[SetUpFault]:
    """Observables that lie far from the calibrated model, as of a wrong unit; amounts above a floor may."""
    rows, mean = race.prepared.rows, race.bare.mean
    for index, observable in enumerate(rows.observables):
        mask = (rows.which == index) & ~rows.censored
        measured, predicted = (from_scale(observable, values[mask]) for values in (rows.z, mean))
        sound = (measured > 0.0) & (predicted > 0.0)
        ratio = float(np.median(measured[sound] / predicted[sound])) if sound.any() else 1.0
        if observable.transform != "log_floor" and not 1.0 / FAR_OFF < ratio < FAR_OFF:
            words = FAULTS["unit"].format(observable.name, plain(ratio, 2), unit_mistake_text(ratio))
            yield SetUpFault("unit", observable.name, words, True)


def table_faults(problem: Problem) -> Iterator[SetUpFault]:
    """What the table of a study cannot carry, known before its model is asked.

    Repeats, held-out rows included, of which one is wrong, or that differ more than is stated; fewer rows
    under different conditions than tell apart what may act.
    """
    whole = problem.measurements
    rows = comparison_rows(problem, whole)
    for name, noise in rows.noise.items():
        if noise.scatter.factor > UNLIKE and noise.scatter.p < FAMILYWISE:
            words = FAULTS["scatter"].format(name, plain(noise.scatter.factor, 2))
            yield SetUpFault("scatter", name, words, False)
    for each in rows.unmerged:
        gap = whole.table_units.value_text(each.observable, each.gap)
        words = FAULTS["repeats"].format(each.observable, row_list(each.lines), gap, row_list(each.suspects))
        yield SetUpFault("repeats", each.observable, words, False, tuple(each.suspects))
    table, hidden = problem.visible_rows(), len(problem.vault.rows)
    points = distinct_row_count(table, condition_groups(table), np.ones(table.size, dtype=np.bool_))
    numbers = (*(each.path for each in problem.parameters), *(each.name for each in problem.adopted))
    if (problem.candidates or points > 1) and points < len(numbers) + SPARE:
        names = join_words(in_words(each.rpartition(".")[2]) for each in numbers) or "nothing"
        words = FAULTS["too_few_rows"].format(points, len(numbers) + SPARE, names)
        words += FAULTS["held_out"].format(hidden) * bool(hidden)
        yield SetUpFault("too_few_rows", "table", words, True)
