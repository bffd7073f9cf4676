"""A study that scenes answer: its simulator, its candidates from the library, their uncertain parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import numpy as np

from taichi_erosion.campaign.study_file import ALL, AdoptedEntry, CandidateEntry, StudyFile
from taichi_erosion.core.effect import Effect
from taichi_erosion.core.errors import BadInput
from taichi_erosion.effects import load_library
from taichi_erosion.evidence.data.problem import (
    Bools,
    Candidate,
    Conditions,
    Measurements,
    Numbers,
    Parameter,
    with_stated,
)
from taichi_erosion.evidence.models.simulator import (
    CONDITIONS,
    SceneMeasure,
    Simulator,
    cached_scene,
    dotted_paths,
    effect_mask,
    stated_conditions,
    stated_numbers,
)
from taichi_erosion.scene import scene_hash


def study_simulator(path: Path, file: StudyFile, table: Measurements, folder: Path) -> Simulator:
    """Simulator of the scenes of a study; raises BadInput where a scene cannot answer."""
    numbers = scene_numbers(file, table)
    units = dict(zip(table.observable, table.unit, strict=True))
    measures, refusals = {}, {}
    for name, entry in file.observables.items():
        assert entry.scene is not None
        scene = (path.parent / entry.scene).resolve()
        measure, there = entry.measure or name, cached_scene(scene, ()).measure
        if measure not in there:
            told = f"{entry.scene} measures {', '.join(there) or 'nothing'}, not {measure}"
            raise BadInput(f"{path}: observables.{name}: {told}")
        refusals |= {(scene, number): refusal(scene, number, value) for number, value in numbers.items()}
        accepted_paths = frozenset(number for number in numbers if refusals[scene, number] is None)
        measures[name] = SceneMeasure(scene, measure, units[name], accepted_paths)
    for (_, number), reason in refusals.items():
        if not any(number in measure.accepted_paths for measure in measures.values()):
            raise BadInput(f"{path}: {number} fits no scene of the study: {reason}")
    return Simulator(measures, load_library(), folder)


def scene_numbers(file: StudyFile, table: Measurements) -> Numbers:
    """Numbers that the study sets in scenes, each with a value that it will have."""
    measured = {
        path: column[np.isfinite(column)]
        for name, paths in file.conditions.items()
        for path in dotted_paths(paths)
        for column in (table.conditions[name],)
    }
    conditions = {path: float(known[0]) for path, known in measured.items() if known.size}
    return conditions | {name: entry.start for name, entry in file.parameters.items()}


def refusal(scene: Path, number: str, value: float) -> str | None:
    """Why a scene cannot take a number, None where it can."""
    try:
        cached_scene(scene, (f"{number}={value!r}",))
    except BadInput as error:
        return str(error)
    return None


def scene_identity(simulator: Simulator) -> str:
    """Names and hashes of the scenes that answer."""
    scenes = dict.fromkeys(measure.scene for measure in simulator.measures.values())
    return ", ".join(f"{scene.name} {scene_hash(cached_scene(scene, ()))}" for scene in scenes)


def library_candidates(file: StudyFile, simulator: Simulator, name: str) -> list[Candidate]:
    """Effects of the library that a study tries, with what the library and the study say about them."""
    wanted, library = file.candidates, simulator.library
    names = list(library) if wanted.effects == (ALL,) else list(wanted.effects or wanted.tables)
    for effect in (*names, *wanted.tables, *file.adopted):
        if effect not in library:
            raise BadInput(f"{name}: candidates.{effect} is not in the library: {', '.join(library)}")
    return [
        library_candidate(simulator, effect, wanted.tables.get(effect, CandidateEntry()), file.conditions)
        for effect in dict.fromkeys(names)
        if effect not in file.adopted
    ]


def library_candidate(
    simulator: Simulator, name: str, entry: CandidateEntry | AdoptedEntry, columns: Mapping[str, str]
) -> Candidate:
    """One effect; the study overrides the library."""
    effect = simulator.library[name]
    known = Candidate(
        name, effect.prior_scale, effect.most, partial(can_act, simulator, effect, dict(columns))
    )
    return with_stated(known, prior_scale=entry.prior_scale, maximum=entry.max)


def uncertain_parameters(
    file: StudyFile, simulator: Simulator, table: Measurements, candidates: Sequence[Candidate]
) -> tuple[Parameter, ...]:
    """Parameters of effects that the literature leaves open and these measurements could determine.

    They could where an effect acts under more than one value of the conditions that it reads: the growth of
    cohesion with water cannot be identified from one moisture. The prior is about the value in the scene.
    """
    found = []
    for candidate in candidates:
        effect = simulator.library[candidate.name]
        ranges = {f.name: f.metadata for f in fields(effect.params)}
        if effect.uncertain and level_count(file, table, candidate, effect) > 1:
            for name, sd in effect.uncertain.items():
                path = f"effects.{effect.name}.{name}"
                start, low, high = (
                    stated_value(simulator, effect, name),
                    ranges[name]["low"],
                    ranges[name]["high"],
                )
                found.append(Parameter(path, start, low, high, sd))
    return tuple(number for number in found if number.path not in file.parameters)


def level_count(file: StudyFile, table: Measurements, candidate: Candidate, effect: Effect) -> int:
    """Different values of the conditions that an effect reads, among the rows where it can act."""
    read = {f"{CONDITIONS}{name}" for name in effect.reads}
    columns = [
        table.conditions[name] for name, paths in file.conditions.items() if read & {*dotted_paths(paths)}
    ]
    mask = np.ones(table.size, bool) if candidate.mask is None else candidate.mask(table.conditions)
    return len({tuple(f"{column[i]:.9g}" for column in columns) for i in np.flatnonzero(mask)})


def stated_value(simulator: Simulator, effect: Effect, name: str) -> float:
    """A number of an effect as the scenes state it, else its usual value."""
    for measure in simulator.measures.values():
        entry = stated_numbers(measure.scene, effect.name)
        if name in entry:
            return entry[name]
    return getattr(effect.params(), name)


def accepting(simulator: Simulator, numbers: Sequence[Parameter]) -> Simulator:
    """The simulator whose scenes accept some parameters of effects too."""
    paths = {number.path for number in numbers}
    measures = {
        name: replace(measure, accepted_paths=measure.accepted_paths | paths)
        for name, measure in simulator.measures.items()
    }
    return replace(simulator, measures=measures)


def can_act(
    simulator: Simulator, effect: Effect, columns: Mapping[str, str], conditions: Conditions
) -> Bools:
    """Rows of a table in which an effect can act in some scene of the study."""
    by_path = {path: column for name, column in conditions.items() for path in dotted_paths(columns[name])}
    scenes = {measure.scene for measure in simulator.measures.values()}
    return np.any([effect_mask(effect, by_path, stated_conditions(scene)) for scene in scenes], axis=0)
