"""The simulator as a model: conditions, parameters and effect strengths become entries of scene files.

Every (condition, seed) of a request is one replica of a campaign; what stands in the ledger of the results
folder is not run again. A seed fixes packing and every random number, so that runs with and without an effect
are paired. A condition that nothing in a run reads does not enter it: the bare model is run once for all
moistures, and where an effect cannot act the run is that of the bare model.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from math import isfinite
from pathlib import Path

import numpy as np

from taichi_erosion.campaign.execute import execute
from taichi_erosion.campaign.ledger import Ledger, open_ledger
from taichi_erosion.campaign.request import RunRequest, RunResult, request_of
from taichi_erosion.core.effect import STRENGTH, Effect
from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.evidence.data.problem import Bools, Conditions, Floats, Integers, Numbers
from taichi_erosion.evidence.data.transforms import effect_of
from taichi_erosion.evidence.data.units import conversion, parse_unit
from taichi_erosion.run.checks import read_scene
from taichi_erosion.scene import Scene

CONDITIONS = "conditions."  # dotted path of what a laboratory writes beside a measurement
# read by effects alone: without such an effect the run does not depend on them
FOR_EFFECTS = ("moisture", "angularity", "clay_fraction", "organic_fraction", "salinity", "rest_duration")
MOST_SCENES = 20_000  # validated scenes that are kept

Report = Callable[[float, str], None]


@dataclass(frozen=True)
class SceneMeasure:
    """What answers an observable: a measure of a scene, and the unit in which the study counts it."""

    scene: Path
    measure: str
    unit: str
    accepted_paths: frozenset[str]  # paths of conditions and parameters that the scene has


@dataclass
class Simulator:
    """Scenes that answer the observables of a study."""

    answers: Mapping[str, SceneMeasure]
    library: Mapping[str, Effect]
    folder: Path  # of the ledger
    report: Report | None = None
    store: Ledger | None = field(default=None, repr=False)

    def __call__(
        self, observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
    ) -> Floats:
        """Predictions [seed, row]; NaN where a run failed. Raises SimulationStopped where all did."""
        answer = self.answers[observable]
        rows = len(next(iter(conditions.values()))) if conditions else 1
        requests: list[RunRequest] = []
        for row in range(rows):
            at = {path: float(column[row]) for said, column in conditions.items() for path in paths_in(said)}
            scene = read_scene_once(answer.scene, self.overrides(answer, at, parameters, effects))
            requests += [request_of(scene, int(seed)) for seed in seeds]
        results = execute(requests, self.opened(), progress=self.report)
        refuse_if_all_failed(results, observable)
        values = np.array([value_in(result, answer) for result in results])
        return values.reshape(rows, len(seeds)).T

    def overrides(
        self,
        answer: SceneMeasure,
        at: Mapping[str, float],
        parameters: Mapping[str, float],
        effects: Mapping[str, float],
    ) -> tuple[str, ...]:
        """PATH=VALUE words of one run."""
        acting = {
            name: psi for name, psi in effects.items() if psi != 0.0 and self.can_act(name, answer.scene, at)
        }
        present = {*acting, *effects_of(answer.scene)}
        read = {name for effect in present for name in self.library[effect].reads}
        kept = {path: value for path, value in at.items() if isfinite(value) and enters(path, read)}
        numbers = {
            path: value
            for path, value in {**kept, **parameters}.items()
            if path in answer.accepted_paths and moves(path, present)
        }
        words = numbers | {f"effects.{name}.strength": psi for name, psi in acting.items()}
        return tuple(f"{path}={float(value)!r}" for path, value in words.items())

    def can_act(self, effect: str, scene: Path, at: Mapping[str, float]) -> bool:
        """Whether an effect can act under some conditions; what they leave out the scene may state."""
        columns = {path: np.array([value]) for path, value in at.items()}
        return bool(mask_of(self.library[effect], columns, stated_conditions(scene))[0])

    def opened(self) -> Ledger:
        """The ledger, opened at first need."""
        if self.store is None:
            self.store = open_ledger(self.folder)
        return self.store


@lru_cache(maxsize=MOST_SCENES)
def read_scene_once(path: Path, overrides: tuple[str, ...]) -> Scene:
    """A validated scene; the observables of one scene ask for the same ones."""
    return read_scene(path, overrides)


def effects_of(scene: Path) -> set[str]:
    """Effects that act in a scene as it stands; one of strength 0 only states its parameters."""
    entries = read_scene_once(scene, ()).effects
    return {name for name, entry in entries.items() if entry.get(STRENGTH, 1.0) > 0.0}


def enters(path: str, read: set[str]) -> bool:
    """Whether a condition can change a run in which the conditions `read` are read by effects."""
    name = path.removeprefix(CONDITIONS)
    return not path.startswith(CONDITIONS) or name not in FOR_EFFECTS or name in read


def moves(path: str, present: Collection[str]) -> bool:
    """Whether a calibrated number can change a run in which some effects act: an effect's own needs it."""
    effect = effect_of(path)
    return effect is None or effect in present


def paths_in(said: str) -> list[str]:
    """Dotted paths that take the value of a column: one, or several joined by commas."""
    return [path.strip() for path in said.split(",")]


def stated_conditions(scene: Path) -> dict[str, float]:
    """Conditions that a scene states itself."""
    return read_scene_once(scene, ()).conditions.model_dump(exclude_none=True)


def stated_numbers(scene: Path, effect: str) -> dict[str, float]:
    """Numbers of an effect, but for its strength, that a scene states itself."""
    entries = read_scene_once(scene, ()).effects.get(effect, {})
    return {name: value for name, value in entries.items() if name != STRENGTH}


def mask_of(effect: Effect, columns: Conditions, stated: Mapping[str, float]) -> Bools:
    """Rows in which an effect can act; what a row leaves out is as the scene states it."""
    known = known_conditions(columns, stated)
    size = len(next(iter(columns.values()))) if columns else 1
    return np.broadcast_to(np.asarray(effect.can_act(known), dtype=np.bool_), size)


def known_conditions(columns: Conditions, stated: Mapping[str, float]) -> Conditions:
    """Conditions of rows by name; what a row leaves out is as the scene states it."""
    size = len(next(iter(columns.values()))) if columns else 1
    known = {name: np.full(size, value) for name, value in stated.items()}
    for path, column in columns.items():
        name = path.removeprefix(CONDITIONS)
        if path.startswith(CONDITIONS) and bool(np.isfinite(column).any()):
            known[name] = np.where(np.isfinite(column), column, known.get(name, np.nan))
    return known


def value_in(result: RunResult, answer: SceneMeasure) -> float:
    """Measured value in the study's unit, NaN where there is none."""
    unit = result.record.get("measures", {}).get(answer.measure, {}).get("unit")
    if result.failure or unit is None:
        return float("nan")
    factor = conversion(parse_unit(unit), parse_unit(answer.unit))
    if factor is None:
        raise BadInput(
            f"{answer.scene}: {answer.measure} is measured in {unit}, the study counts {answer.unit}"
        )
    return factor * result.value(answer.measure)


def refuse_if_all_failed(results: Sequence[RunResult], observable: str) -> None:
    """Raise SimulationStopped where no run came to its end: nothing can be learnt from that."""
    failures = [result.failure for result in results if result.failure]
    if results and len(failures) == len(results):
        raise SimulationStopped(f"{observable}: all {len(results)} runs stopped; the first: {failures[0]}")
