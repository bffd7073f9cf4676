"""Scenes that answer a study: conditions, parameters and effect strengths become entries of scene files.

A condition that nothing in a run reads does not enter it: the bare model is run once for all moistures, and
where an effect cannot act the run is that of the bare model.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from math import isfinite
from pathlib import Path

import numpy as np

from taichi_erosion.campaign.ledger import Ledger, open_ledger
from taichi_erosion.campaign.request import CPU, RunResult
from taichi_erosion.campaign.study_file import ALL, AdoptedEntry, CandidateEntry, StudyFile, WorkersEntry
from taichi_erosion.core.effect import STRENGTH, Effect
from taichi_erosion.core.effect_file import effect_in, failures_of
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import (
    Bools,
    Candidate,
    Conditions,
    Measurements,
    Numbers,
    Parameter,
    row_count,
)
from taichi_erosion.evidence.data.transforms import effect_of_path
from taichi_erosion.execution.checks import EffectFiles, read_scene, scene_effect_files
from taichi_erosion.mechanisms.library import DOSE, mechanism_file
from taichi_erosion.scene import Scene
from taichi_erosion.scene.schema.conditions import Conditions as PredefinedConditions
from taichi_erosion.scene.schema.units import conversion_factor, parse_unit

CONDITIONS = "conditions."  # prefix of the dotted path of a condition
EXTRA, VALUE = "extra.", ".value"  # of the long path of a condition that a user declares
# read by effects alone: without such an effect the run does not depend on them
FOR_EFFECTS = ("moisture", "angularity", "clay_fraction", "organic_fraction", "salinity", "rest_duration")
MOST_SCENES = 20_000  # validated scenes that are kept


@dataclass(frozen=True)
class SceneMeasure:
    """The measure of a scene that answers an observable, and the study's unit of it."""

    scene: Path
    measure: str
    unit: str
    accepted_paths: frozenset[str]  # paths of conditions and parameters that the scene has


@dataclass
class Simulator:
    """Scenes that answer the observables of a study."""

    measures: Mapping[str, SceneMeasure]
    library: Mapping[str, Effect]
    folder: Path  # of the ledger
    effect_files: EffectFiles = ()  # of the study and its scenes
    study_effects: tuple[str, ...] = ()  # effects of the study's files: candidates
    mechanisms: tuple[str, ...] = ()  # of the library, known by their doses in place of strengths
    device: WorkersEntry = CPU
    ledger: Ledger | None = field(default=None, repr=False)

    def overrides(
        self,
        measure: SceneMeasure,
        at: Mapping[str, float],
        parameters: Mapping[str, float],
        effects: Mapping[str, float],
    ) -> tuple[str, ...]:
        acting = {n: psi for n, psi in effects.items() if psi != 0.0 and self.can_act(n, measure.scene, at)}
        present = {*acting, *self.effects_acting_in_scene(measure.scene)}
        read = {name for effect in present for name in self.library[effect].reads}
        finite = {path: each for path, each in at.items() if isfinite(each) and condition_matters(path, read)}
        numbers = {path: x for path, x in {**finite, **parameters}.items() if path in measure.accepted_paths}
        entries = {path: x for path, x in numbers.items() if parameter_can_change_run(path, present)}
        for name, psi in acting.items():
            entries[f"effects.{name}.{DOSE if name in self.mechanisms else STRENGTH}"] = psi
        return tuple(f"{path}={float(value)!r}" for path, value in entries.items())

    def simulator_with_mechanisms(self, names: Sequence[str]) -> "Simulator":
        """The same with some mechanisms in its library; the ledger is shared."""
        files = tuple(mechanism_file(name) for name in names)
        library = dict(self.library) | {effect_in(file).name: effect_in(file) for file in files}
        ledger, every = self.shared_ledger(), (*self.effect_files, *files)
        return replace(self, library=library, effect_files=every, mechanisms=tuple(names), ledger=ledger)

    def can_act(self, effect: str, scene: Path, at: Mapping[str, float]) -> bool:
        """Whether an effect can act under some conditions; the scene may state what they leave out."""
        columns = {path: np.array([value]) for path, value in at.items()}
        return bool(self.rows_where_effect_can_act(self.library[effect], columns, scene)[0])

    def load_scene_at(self, path: Path, overrides: tuple[str, ...] = ()) -> Scene:
        """A validated scene, with the effects of the study's files."""
        return cached_scene(path, overrides, self.effect_files)

    def effects_acting_in_scene(self, scene: Path) -> set[str]:
        """Effects that act in a scene as its file stands; one of strength 0 only states its parameters."""
        entries = self.load_scene_at(scene).effects
        return {name for name, entry in entries.items() if entry.get(STRENGTH, 1.0) > 0.0}

    def scene_numbers_of(self, scene: Path, effect: str) -> Numbers:
        """Numbers of an effect, but for its strength, that a scene states itself."""
        entries = self.load_scene_at(scene).effects.get(effect, {})
        return {name: value for name, value in entries.items() if name != STRENGTH}

    def rows_where_effect_can_act(self, effect: Effect, columns: Conditions, scene: Path) -> Bools:
        """Rows in which an effect can act; what a row leaves out is as the scene states it."""
        conditions = self.stated_columns(columns, scene)
        with failures_of(effect, "can_act"):
            return np.broadcast_to(np.asarray(effect.can_act(conditions), dtype=np.bool_), row_count(columns))

    def stated_columns(self, columns: Conditions, scene: Path) -> Conditions:
        """Conditions of rows as effects read them; what a row leaves out is as the scene states it."""
        section = self.load_scene_at(scene).conditions
        conditions = {name: np.full(row_count(columns), x) for name, x in section.values_in_si().items()}
        for path, column in columns.items():
            name = condition_name_of_dotted_path(path)
            if name is not None and bool(np.isfinite(column).any()):
                values = section.extra[name].value_in_si(column) if name in section.extra else column
                conditions[name] = np.where(np.isfinite(column), values, conditions.get(name, np.nan))
        return conditions

    def shared_ledger(self) -> Ledger:
        if self.ledger is None:
            self.ledger = open_ledger(self.folder)
        return self.ledger


cached_scene = lru_cache(maxsize=MOST_SCENES)(read_scene)  # the observables of one scene need the same ones


def condition_name_of_dotted_path(path: str) -> str | None:
    """Name of the condition that a dotted path sets, None for a path of another section."""
    if not path.startswith(CONDITIONS):
        return None
    return path.removeprefix(CONDITIONS).removeprefix(EXTRA).removesuffix(VALUE)


def condition_matters(path: str, read: set[str]) -> bool:
    """Whether a condition can change a run in which the conditions `read` are read by effects."""
    name = condition_name_of_dotted_path(path)
    for_effects = name in FOR_EFFECTS or name not in PredefinedConditions.model_fields
    return name is None or not for_effects or name in read


def parameter_can_change_run(path: str, present: Collection[str]) -> bool:
    """Whether a calibrated number can change a run in which some effects act: an effect's own needs it."""
    effect = effect_of_path(path)
    return effect is None or effect in present


def dotted_paths(name: str) -> list[str]:
    """Dotted paths that a column sets: one, or several joined by commas."""
    return [path.strip() for path in name.split(",")]


def row_at(conditions: Conditions, row: int) -> Numbers:
    return {path: float(column[row]) for name, column in conditions.items() for path in dotted_paths(name)}


def study_value(result: RunResult, measure: SceneMeasure) -> float:
    """Measured value in the study's unit, NaN where there is none."""
    unit = result.record.get("measures", {}).get(measure.measure, {}).get("unit")
    if result.failure or unit is None:
        return float("nan")
    factor = conversion_factor(parse_unit(unit), parse_unit(measure.unit))
    if factor is None:
        message = f"{measure.scene}: {measure.measure} is measured in {unit}"
        raise BadInput(f"{message}, the study counts {measure.unit}")
    return factor * result.value(measure.measure)


def study_simulator(
    path: Path, file: StudyFile, table: Measurements, folder: Path, effect_files: EffectFiles = ()
) -> Simulator:
    """Simulator of the scenes of a study; raises BadInput where a scene cannot answer."""
    from taichi_erosion.effect_library import load_library

    scenes = {name: (path.parent / str(each.scene)).resolve() for name, each in file.observables.items()}
    read = [cached_scene(scene, (), effect_files) for scene in sorted({*scenes.values()})]
    files = tuple(dict.fromkeys((*effect_files, *(each for one in read for each in scene_effect_files(one)))))
    names = tuple(effect_in(each).name for each in effect_files)
    simulator = Simulator({}, load_library(files), folder, files, names, device=file.campaign)
    numbers: Numbers = {}  # that the study sets in scenes, each with a value that it will have
    for name, paths in file.conditions.items():
        finite = table.conditions[name][np.isfinite(table.conditions[name])]
        numbers |= {path: float(finite[0]) for path in dotted_paths(paths) if finite.size}
    numbers |= {name: entry.start for name, entry in file.parameters.items()}
    units = dict(zip(table.observable, table.unit, strict=True))
    measures, refusals = {}, {}
    for name, entry in file.observables.items():
        scene, measure = scenes[name], entry.measure or name
        there = simulator.load_scene_at(scene).measure
        if measure not in there:
            message = f"{entry.scene} measures {', '.join(there) or 'nothing'}, not {measure}"
            raise BadInput(f"{path}: observables.{name}: {message}")
        refusals |= {(scene, n): refusal_of_number(scene, n, value, files) for n, value in numbers.items()}
        accepted_paths = frozenset(number for number in numbers if refusals[scene, number] is None)
        measures[name] = SceneMeasure(scene, measure, units[name], accepted_paths)
    for (_, number), reason in refusals.items():
        if not any(number in measure.accepted_paths for measure in measures.values()):
            raise BadInput(f"{path}: {number} fits no scene of the study: {reason}")
    return replace(simulator, measures=measures)


def refusal_of_number(scene: Path, number: str, value: float, files: EffectFiles) -> str | None:
    """Why a scene cannot take a number, None where it can."""
    try:
        cached_scene(scene, (f"{number}={value!r}",), files)
    except BadInput as error:
        return str(error)
    return None


def library_candidates(file: StudyFile, simulator: Simulator, name: str) -> list[Candidate]:
    """Effects of the library that a study tries, with the priors of the library and of the study.

    An effect that acts in a scene of the study is part of its model, and no candidate.
    """
    choice, library = file.candidates, simulator.library
    scenes = {measure.scene for measure in simulator.measures.values()}
    acting = {each for scene in scenes for each in simulator.effects_acting_in_scene(scene)}
    names = list(library) if choice.effects == (ALL,) else list(choice.effects or choice.tables)
    if choice.effects != (ALL,) and (twice := acting.intersection(names) - set(file.adopted)):
        raise BadInput(f"{name}: candidates.{min(twice)} acts in a scene already: it is part of the model")
    names += simulator.study_effects  # to name a file is to try its effect
    for effect in (*names, *choice.tables, *file.adopted):
        if effect not in library:
            raise BadInput(f"{name}: candidates.{effect} is not in the library: {', '.join(library)}")
    tried = (name for name in dict.fromkeys(names) if name not in file.adopted and name not in acting)
    return [as_candidate(each, choice.tables.get(each, CandidateEntry()), library) for each in tried]


def unread_conditions(
    file: StudyFile, simulator: Simulator, tried: Sequence[Candidate]
) -> Iterator[tuple[str, str]]:
    """Conditions that change no run, with a sentence: no effect of the scenes and no candidate reads them."""
    acting = [simulator.effects_acting_in_scene(each.scene) for each in simulator.measures.values()]
    present = {each.name for each in tried}.union(file.adopted, *acting)
    conditions = {name for effect in present for name in simulator.library[effect].reads}
    for name, paths in file.conditions.items():
        names = {condition_name_of_dotted_path(path) for path in dotted_paths(paths)}
        able = ", ".join(key for key, effect in simulator.library.items() if names & {*effect.reads})
        remedy = f"{able} can: [candidates] effects" if able else "one of your own can: --effect FILE"
        if not any(condition_matters(path, conditions) for path in dotted_paths(paths)):
            yield name, f"{name} changes no run: no effect of the scenes and no candidate reads it; {remedy}."


def as_candidate(name: str, entry: CandidateEntry | AdoptedEntry, effects: Mapping[str, Effect]) -> Candidate:
    """An effect with the prior of its file, if there is one; the study overrides it."""
    effect = effects.get(name)
    candidate = Candidate(name, effect.prior_scale, effect.most) if effect else Candidate(name)
    entries = {"prior_scale": entry.prior_scale, "maximum": entry.max}
    return replace(candidate, **{name: value for name, value in entries.items() if value is not None})


def uncertain_parameters(
    file: StudyFile, simulator: Simulator, table: Measurements, candidates: Sequence[Candidate]
) -> tuple[Parameter, ...]:
    """Parameters of effects that the literature leaves open and these measurements could determine.

    They could where an effect acts under more than one value of the conditions that it reads: the growth of
    cohesion with water cannot be identified from one moisture. The prior is about the value in the scene.
    """
    parameters, scenes = [], {measure.scene for measure in simulator.measures.values()}
    columns = table.conditions.items()
    column_of = {path: each for name, each in columns for path in dotted_paths(file.conditions[name])}
    for candidate in candidates:
        effect = simulator.library[candidate.name]
        ranges = {each.name: each.metadata for each in fields(effect.params)}
        read = {f"{CONDITIONS}{name}" for name in effect.reads}
        columns = [table.conditions[name] for name, p in file.conditions.items() if read & {*dotted_paths(p)}]
        able = [simulator.rows_where_effect_can_act(effect, column_of, scene) for scene in scenes]
        mask = np.any(able, axis=0)
        levels = {tuple(f"{column[i]:.9g}" for column in columns) for i in np.flatnonzero(mask)}
        for name, sd in effect.uncertain.items() if len(levels) > 1 else ():
            path = f"effects.{effect.name}.{name}"
            entries = (simulator.scene_numbers_of(m.scene, effect.name) for m in simulator.measures.values())
            start = next((entry[name] for entry in entries if name in entry), getattr(effect.params(), name))
            if path not in file.parameters:
                parameters.append(Parameter(path, start, ranges[name]["low"], ranges[name]["high"], sd))
    return tuple(parameters)
