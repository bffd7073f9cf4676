"""Validation of a study without a run: its file, its table, its scenes or model, and what an answer costs.

All faults are told at once, each in one line; parts that rest on a faulty one are left out.
"""

from collections.abc import Iterator
from dataclasses import replace
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from taichi_erosion.campaign.ledger import close_ledger
from taichi_erosion.campaign.study_file import (
    ALL,
    StudyFile,
    calibration_problems,
    evidence_problems,
    read_study_file,
)
from taichi_erosion.core.effect_loading import effect_in
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.foreign_code import EffectFile
from taichi_erosion.evidence.answers.rounds import MOST_POINTS
from taichi_erosion.evidence.answers.set_up import source_faults, table_faults
from taichi_erosion.evidence.data.measured import read_table, study_measurements
from taichi_erosion.evidence.data.problem import expected_strength
from taichi_erosion.evidence.data.tables.rows import Faults, Table
from taichi_erosion.evidence.emulator.design import inactive_reason
from taichi_erosion.evidence.emulator.plan_cost import MINUTE, PlanCost, function_cost, plan_cost
from taichi_erosion.evidence.emulator.training_runs import TrainingRuns, initial_training_runs, study_scenes
from taichi_erosion.evidence.models.load_study import (
    NO_OPTIONS,
    PLANS,
    Study,
    StudyOptions,
    load_study,
    study_effect_files,
)
from taichi_erosion.evidence.models.simulator import dotted_paths
from taichi_erosion.evidence.models.table_columns import place_units, study_value_faults
from taichi_erosion.run.checks import read_scene
from taichi_erosion.verification.effect_contract import examined_file

Document = dict[str, Any]
UNEXPECTED = "the literature expects none of these observables to change with it"
EXPECTED_AS = {  # observable -> the one of which the literature tells the effects: a steeper heap is higher
    **dict.fromkeys(("angle_of_repose", "cone_angle", "dynamic_angle", "runout_radius"), "repose_angle"),
    **dict.fromkeys(("pile_height", "centroid_height", "radius_90", "column_height"), "repose_angle"),
    **dict.fromkeys(("threshold_wind_speed", "rolling_onset"), "threshold_u_star"),
    **dict.fromkeys(("impact_threshold", "impact_threshold_linear"), "threshold_u_star"),
    "flux_height": "flux",
}


def check_study(path: Path, options: StudyOptions = NO_OPTIONS) -> Document:
    """What a valid study holds, and what an answer costs; raises BadInput with all faults.

    Effect files are examined against the contract of effects, which starts the device.
    """
    file, faults = read_any_study(path), Faults()
    if file.targets and not file.study.measurements:
        scenes = {name: path.parent / str(entry.scene) for name, entry in file.observables.items()}
        for scene in dict.fromkeys(scenes.values()):
            faults.of(read_scene, scene, ())
        faults.tell()
        return {"study": str(path), "kind": "calibration", "observables": list(file.observables)}
    files = faults.of(study_effect_files, path, file, options) or ()
    table = checked_table(path, file, files, faults)
    for place, fault in scene_faults(path, file, files):
        faults.append(f"{path}: {place}: {fault}")
    faults.extend(candidate_faults(path, file, files))
    examined = [found for each in files if (found := faults.of(examined_file, each)) is not None]
    faults.tell()
    assert table is not None
    return study_document(load_study(path, options), table) | {"effects": examined}


def read_any_study(path: Path) -> StudyFile:
    """A study file of either kind; raises BadInput with all its faults."""

    def problems(file: StudyFile) -> Iterator[str]:
        designed = bool(file.targets) and not file.study.measurements
        yield from (calibration_problems if designed else evidence_problems)(file)

    return read_study_file(path, problems)


def checked_table(path: Path, file: StudyFile, files: tuple[EffectFile, ...], faults: Faults) -> Table | None:
    """The table of a study, with its units and ranges looked at."""
    table = faults.of(read_table, path.parent / file.study.measurements, file.study.measurements, file)
    places = faults.of(place_units, file, path, files)
    if table is not None and places is not None:
        faults.of(study_measurements, table, file, str(path), places)
        faults.extend(study_value_faults(table, file, path.parent))
    return table


def scene_faults(path: Path, file: StudyFile, files: tuple[EffectFile, ...]) -> Iterator[tuple[str, str]]:
    """Scenes that cannot be read, or do not measure what they should."""
    for name, entry in file.observables.items():
        if entry.scene is None:
            continue
        try:
            scene = read_scene((path.parent / entry.scene).resolve(), (), files)
        except BadInput as error:
            yield from ((f"observables.{name}.scene", fault) for fault in error.faults)
            continue
        measure = entry.measure or name
        if measure not in scene.measure:
            there = ", ".join(scene.measure) or "nothing"
            yield f"observables.{name}", f"{entry.scene} measures {there}, not {measure}"


def candidate_faults(path: Path, file: StudyFile, files: tuple[EffectFile, ...]) -> Iterator[str]:
    """Candidates that the library has not."""
    if file.study.model is not None:
        return
    from taichi_erosion.effects import load_library

    library = load_library(files)
    for name in dict.fromkeys((*file.candidates.effects, *file.candidates.tables, *file.adopted)):
        if name not in library and name != ALL:
            yield f"{path}: candidates.{name} is not in the library: {', '.join(library)}"


def study_document(study: Study, table: Table) -> Document:
    """What was found, as a document."""
    measurements, file = study.problem.measurements, study.file
    faults = (*table_faults(study.problem), *source_faults(study))
    return {
        "study": str(study.path),
        "kind": "evidence",
        "rows": measurements.size,
        "held_out": len(study.problem.vault.rows),
        "drawn_from": study.drawn_from,
        "observables": {name: measurements.observable.count(name) for name in file.observables},
        "conditions": {name: told_range(table, name) for name in file.conditions},
        "parameters": [parameter.path for parameter in study.problem.parameters],
        "candidates": study.problem.candidate_names,
        "notes": [*(fault.sentence for fault in faults), *study.notes],
        "cost": study_cost(study),
    }


def told_range(table: Table, name: str) -> str:
    """Range of a condition as the table has it."""
    place = table.conditions.index(name)
    values = [row.conditions[place] for row in table.rows if isfinite(row.conditions[place])]
    unit = table.units[place] or ""
    return f"{min(values):g} to {max(values):g} {unit}".strip() if values else "not stated"


def acting_candidates(study: Study) -> tuple[list[str], dict[str, str]]:
    """Effects of the library that can change what is measured here, and why the others cannot.

    Where the literature does not say which observables an effect changes, it is a candidate if the table
    holds a condition that it reads. Where that leaves none, all that can act are candidates.
    """
    simulator = study.simulator
    assert simulator is not None
    scenes = study_scenes(study, simulator)
    varied = {
        path.removeprefix("conditions.")
        for paths in study.file.conditions.values()
        for path in dotted_paths(paths)
    }
    measured = study.file.observables
    known = {*measured, *(EXPECTED_AS[name] for name in measured if name in EXPECTED_AS), *varied}
    own = {effect_in(file).name for file in study.effect_files}
    acting, inactive = [], {}
    for candidate in study.problem.candidates:
        effect = simulator.library[candidate.name]
        strength = expected_strength(candidate)
        reasons = [inactive_reason(scene, candidate.name, strength) for scene in scenes]
        if all(reason is not None for reason in reasons):
            inactive[candidate.name] = str(reasons[0])
        elif candidate.name in own or set(effect.expected or effect.reads) & known:
            acting.append(candidate.name)
        else:
            inactive[candidate.name] = UNEXPECTED
    if not acting:
        acting = [name for name, reason in inactive.items() if reason == UNEXPECTED]
    return acting, {name: reason for name, reason in inactive.items() if name not in acting}


def study_cost(study: Study) -> dict[str, Any]:
    """Cost of a discovery with all candidates, by the size of its plan."""
    effects = study.problem.candidate_names
    found: dict[str, Any] = {}
    for name in PLANS:
        planned = initial_training_runs(study, effects, name)
        if planned is None:
            sentence = function_cost(study, len(effects))
            return {"full": {"sentence": sentence}} if sentence else {}
        cost = without_a_trace(planned)
        found[name] = {
            "runs": cost.first + cost.later,
            "kept": cost.kept,
            "core_minutes": cost.seconds * cost.workers / MINUTE,
            "minutes_here": cost.seconds / MINUTE,
            "sentence": cost.sentence,
        }
    return found


def without_a_trace(planned: TrainingRuns) -> PlanCost:
    """Cost of a plan; a study that has no ledger gets none by the question."""
    rounds = planned.plan_size.rounds
    if planned.simulator.folder.exists():
        return plan_cost(planned, rounds, MOST_POINTS)
    with TemporaryDirectory() as folder:
        simulator = replace(planned.simulator, folder=Path(folder), ledger=None)
        cost = plan_cost(replace(planned, simulator=simulator), rounds, MOST_POINTS)
        close_ledger(simulator.opened())
    return cost
