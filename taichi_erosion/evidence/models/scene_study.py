"""A study that scenes answer: which scene takes which number, and what the library knows of the effects."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import numpy as np

from taichi_erosion.campaign.study_file import ALL, AdoptedEntry, CandidateEntry, StudyFile
from taichi_erosion.core.effect import Effect
from taichi_erosion.core.errors import BadInput
from taichi_erosion.effects import load_library
from taichi_erosion.evidence.data.problem import Bools, Candidate, Conditions, Measurements, Parameter
from taichi_erosion.evidence.models.simulator import (
    CONDITIONS,
    SceneMeasure,
    Simulator,
    mask_of,
    paths_in,
    read_scene_once,
    stated_conditions,
    stated_numbers,
)
from taichi_erosion.scene import scene_hash


def simulator_of(path: Path, file: StudyFile, table: Measurements, folder: Path) -> Simulator:
    """The simulator behind a study; raises BadInput where a scene cannot answer."""
    numbers = numbers_of(file, table)
    units = dict(zip(table.observable, table.unit, strict=True))
    answers, refusals = {}, {}
    for name, entry in file.observables.items():
        assert entry.scene is not None
        scene = (path.parent / entry.scene).resolve()
        measure, there = entry.measure or name, read_scene_once(scene, ()).measure
        if measure not in there:
            told = f"{entry.scene} measures {', '.join(there) or 'nothing'}, not {measure}"
            raise BadInput(f"{path}: observables.{name}: {told}")
        refusals |= {(scene, number): refusal(scene, number, value) for number, value in numbers.items()}
        accepted_paths = frozenset(number for number in numbers if refusals[scene, number] is None)
        answers[name] = SceneMeasure(scene, measure, units[name], accepted_paths)
    for (_, number), reason in refusals.items():
        if not any(number in answer.accepted_paths for answer in answers.values()):
            raise BadInput(f"{path}: {number} fits no scene of the study: {reason}")
    return Simulator(answers, load_library(), folder)


def numbers_of(file: StudyFile, table: Measurements) -> dict[str, float]:
    """Numbers that the study sets in scenes, each with a value that it will have."""
    measured = {
        path: column[np.isfinite(column)]
        for name, said in file.conditions.items()
        for path in paths_in(said)
        for column in (table.conditions[name],)
    }
    conditions = {path: float(known[0]) for path, known in measured.items() if known.size}
    return conditions | {name: entry.start for name, entry in file.parameters.items()}


def refusal(scene: Path, number: str, value: float) -> str | None:
    """Why a scene cannot take a number, None where it can."""
    try:
        read_scene_once(scene, (f"{number}={value!r}",))
    except BadInput as error:
        return str(error)
    return None


def identity_of(simulator: Simulator) -> str:
    """Which scenes answer, by content."""
    scenes = dict.fromkeys(answer.scene for answer in simulator.answers.values())
    return ", ".join(f"{scene.name} {scene_hash(read_scene_once(scene, ()))}" for scene in scenes)


def library_candidates(file: StudyFile, simulator: Simulator, name: str) -> list[Candidate]:
    """Effects of the library that a study tries, with what the library and the study say about them."""
    said, library = file.candidates, simulator.library
    names = list(library) if said.effects == (ALL,) else list(said.effects or said.tables)
    for effect in (*names, *said.tables, *file.adopted):
        if effect not in library:
            raise BadInput(f"{name}: candidates.{effect} is not in the library: {', '.join(library)}")
    return [
        library_candidate(simulator, effect, said.tables.get(effect, CandidateEntry()), file.conditions)
        for effect in dict.fromkeys(names)
        if effect not in file.adopted
    ]


def library_candidate(
    simulator: Simulator, name: str, entry: CandidateEntry | AdoptedEntry, columns: Mapping[str, str]
) -> Candidate:
    """One effect; the study's word goes before the library's."""
    effect = simulator.library[name]
    known = Candidate(name, effect.prior_scale, effect.most, partial(acts, simulator, effect, dict(columns)))
    words = {"prior_scale": entry.prior_scale, "maximum": entry.max}
    return replace(known, **{word: said for word, said in words.items() if said is not None})


def own_numbers(
    file: StudyFile, simulator: Simulator, table: Measurements, candidates: Sequence[Candidate]
) -> tuple[Parameter, ...]:
    """Numbers of effects that the literature leaves open and these measurements could settle.

    They could where an effect acts under more than one value of the conditions that it reads: how a pull
    grows with water cannot be told from one moisture. The prior is about what the scene states.
    """
    found = []
    for candidate in candidates:
        effect = simulator.library[candidate.name]
        ranges = {f.name: f.metadata for f in fields(effect.params)}
        if effect.uncertain and levels(file, table, candidate, effect) > 1:
            for name, sd in effect.uncertain.items():
                path = f"effects.{effect.name}.{name}"
                start, low, high = stated(simulator, effect, name), ranges[name]["low"], ranges[name]["high"]
                found.append(Parameter(path, start, low, high, sd))
    return tuple(number for number in found if number.path not in file.parameters)


def levels(file: StudyFile, table: Measurements, candidate: Candidate, effect: Effect) -> int:
    """Different values of the conditions that an effect reads, among the rows where it can act."""
    read = {f"{CONDITIONS}{name}" for name in effect.reads}
    columns = [table.conditions[name] for name, said in file.conditions.items() if read & {*paths_in(said)}]
    mask = np.ones(table.size, bool) if candidate.mask is None else candidate.mask(table.conditions)
    return len({tuple(f"{column[i]:.9g}" for column in columns) for i in np.flatnonzero(mask)})


def stated(simulator: Simulator, effect: Effect, name: str) -> float:
    """A number of an effect as the scenes state it, else its usual value."""
    for answer in simulator.answers.values():
        entry = stated_numbers(answer.scene, effect.name)
        if name in entry:
            return entry[name]
    return getattr(effect.params(), name)


def understanding(simulator: Simulator, numbers: Sequence[Parameter]) -> Simulator:
    """The simulator whose scenes take some numbers of effects too."""
    paths = {number.path for number in numbers}
    answers = {
        name: replace(answer, accepted_paths=answer.accepted_paths | paths)
        for name, answer in simulator.answers.items()
    }
    return replace(simulator, answers=answers)


def acts(simulator: Simulator, effect: Effect, columns: Mapping[str, str], conditions: Conditions) -> Bools:
    """Rows of a table in which an effect can act in some scene of the study."""
    spoken = {path: column for name, column in conditions.items() for path in paths_in(columns[name])}
    scenes = {answer.scene for answer in simulator.answers.values()}
    return np.any([mask_of(effect, spoken, stated_conditions(scene)) for scene in scenes], axis=0)
