"""Surfaces that answer in place of scenes: simulate a plan of runs once, then ask as often as one likes.

The statistics ask a model thousands of questions, and a scene takes seconds for one. Surfaces through some
hundred runs answer them all without scatter; their own uncertainty enters every comparison.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from taichi_erosion.campaign.request import RunResult
from taichi_erosion.core.effect import STRENGTH
from taichi_erosion.core.errors import SimulationStopped
from taichi_erosion.evidence.data.problem import (
    Candidate,
    Conditions,
    Floats,
    Integers,
    Numbers,
    Observable,
    expected_strength,
)
from taichi_erosion.evidence.data.transforms import EFFECTS, Axis, axis_position, from_scale, slope, to_scale
from taichi_erosion.evidence.emulator.design import SceneRows, TrainingRun
from taichi_erosion.evidence.emulator.gaussian_process import (
    ActiveInputs,
    GaussianProcess,
    Points,
    fit_gaussian_process,
)
from taichi_erosion.evidence.models.simulator import (
    SceneMeasure,
    Simulator,
    effects_of,
    enters,
    known_conditions,
    moves,
    paths_in,
    stated_conditions,
    stated_numbers,
    value_in,
)

LEAST_RUNS = 4  # with a value; fewer make no surface
LOG_SPAN = 3.0  # a positive condition that spans more than this factor is taken by its logarithm


@dataclass(frozen=True)
class ConditionScale:
    """How a condition is standardised."""

    centre: float
    width: float
    logarithmic: bool

    def __call__(self, column: Floats) -> Floats:
        """Standardised values; what is not stated lies in the middle."""
        values = np.log(np.maximum(column, 1e-300)) if self.logarithmic else column
        return np.nan_to_num((values - self.centre) / self.width)


@dataclass(frozen=True)
class EmulatorInputs:
    """Coordinates of the surfaces of one scene."""

    answer: SceneMeasure
    axes: tuple[Axis, ...]  # calibrated numbers that the scene understands
    rulers: Mapping[str, ConditionScale]  # of conditions that vary, by dotted path
    candidates: tuple[Candidate, ...]
    simulator: Simulator

    def points(
        self, at: Conditions, parameters: Mapping[str, Floats], effects: Mapping[str, Floats]
    ) -> Points:
        """Coordinates of rows; everything is a column."""
        size = len(next(iter([*at.values(), *parameters.values()]), (0,)))
        x = [position(axis, parameters[axis.name]) for axis in self.axes]
        c = [ruler(at.get(path, np.full(size, np.nan))) for path, ruler in self.rulers.items()]
        psi = [self.strength(candidate, at, parameters, effects, size) for candidate in self.candidates]
        return Points(*(np.array(part, dtype=float).reshape(-1, size).T for part in (x, c, psi)))

    def strength(
        self,
        candidate: Candidate,
        at: Conditions,
        parameters: Mapping[str, Floats],
        effects: Mapping[str, Floats],
        size: int,
    ) -> Floats:
        """Strength over the expected one, times the effect's dose; 0 where the effect cannot act."""
        given = np.broadcast_to(effects.get(candidate.name, 0.0), size)
        if not given.any():
            return np.zeros(size)
        effect, scene = self.simulator.library[candidate.name], self.answer.scene
        known = known_conditions(at, stated_conditions(scene))
        place = f"{EFFECTS}{effect.name}."
        calibrated = {path.removeprefix(place): v for path, v in parameters.items() if path.startswith(place)}
        numbers: dict[str, Any] = {**stated_numbers(scene, effect.name), **calibrated}
        params = effect.params(**{name: value for name, value in numbers.items() if name != STRENGTH})
        dose = np.where(effect.can_act(known), effect.dose(params, known), 0.0)
        return given / expected_strength(candidate) * dose

    def reads(self) -> ActiveInputs:
        """Which conditions and calibrated numbers enter the bare model, and which every effect."""
        library = self.simulator.library
        present = effects_of(self.answer.scene)
        own = {name for effect in present for name in library[effect].reads}
        names = [candidate.name for candidate in self.candidates]
        count, rulers, axes = len(names), len(self.rulers), len(self.axes)

        def entering(*effects: str) -> list[bool]:
            read = own.union(*(library[effect].reads for effect in effects))
            return [enters(path, read) for path in self.rulers]

        def moving(*effects: str) -> list[bool]:
            return [moves(axis.name, {*present, *effects}) for axis in self.axes]

        return ActiveInputs(
            bare=np.array(entering(), dtype=bool),
            effects=np.array([entering(name) for name in names], bool).reshape(count, rulers),
            bare_numbers=np.array(moving(), dtype=bool),
            effect_numbers=np.array([moving(name) for name in names], bool).reshape(count, axes),
        )


def position(axis: Axis, values: Floats) -> Floats:
    """Calibrated numbers in prior sd."""
    return np.array([axis_position(axis, float(value)) for value in np.atleast_1d(values)])


@dataclass(frozen=True)
class ObservableEmulator:
    """Surface of one observable."""

    ground: EmulatorInputs
    scale: Observable  # on which its noise is even; the logarithm of anything above 0
    surface: GaussianProcess


@dataclass(frozen=True)
class Emulator:
    """A model: surfaces by observable. The same answer for every seed."""

    answered: Mapping[str, ObservableEmulator]

    def __call__(
        self, observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
    ) -> Floats:
        """Predictions [seed, row]."""
        found = self.answered[observable]
        rows = len(next(iter(conditions.values()))) if conditions else 1
        mean = found.surface.mean(asked(found.ground, rows, conditions, parameters, effects))
        return np.tile(from_scale(found.scale, mean), (len(seeds), 1))

    def uncertainty(
        self, observable: Observable, conditions: Conditions, parameters: Numbers, effects: Numbers
    ) -> Floats:
        """Covariance of the surface's own errors over some rows, on the comparison scale."""
        found = self.answered[observable.name]
        rows = len(next(iter(conditions.values()))) if conditions else 1
        points = asked(found.ground, rows, conditions, parameters, effects)
        value = from_scale(found.scale, found.surface.mean(points))
        steepness = slope(observable, value) / slope(found.scale, value)
        return found.surface.uncertainty(points) * np.outer(steepness, steepness)


def asked(
    ground: EmulatorInputs, rows: int, conditions: Conditions, parameters: Numbers, effects: Numbers
) -> Points:
    """Coordinates of a request, in which numbers and strengths are the same for all rows."""
    at = {path: column for said, column in conditions.items() for path in paths_in(said)}
    if not at:
        at = {"": np.full(rows, np.nan)}
    numbers = {axis.name: np.full(rows, parameters[axis.name]) for axis in ground.axes}
    return ground.points(at, numbers, {k: np.full(rows, v) for k, v in effects.items() if v != 0.0})


def train(
    bench: SceneRows,
    ground: EmulatorInputs,
    settings: Sequence[TrainingRun],
    results: Sequence[RunResult],
    observables: Mapping[str, Observable],
    answers: Mapping[str, SceneMeasure],
) -> dict[str, ObservableEmulator]:
    """Surfaces of all observables of one scene."""
    at = {path: np.array([s.at.get(path, np.nan) for s in settings]) for path in every_path(settings)}
    at = at or {"": np.full(len(settings), np.nan)}
    numbers = {axis.name: np.array([s.parameters[axis.name] for s in settings]) for axis in ground.axes}
    names = [candidate.name for candidate in ground.candidates]
    effects = {name: np.array([s.effects.get(name, 0.0) for s in settings]) for name in names}
    points, reads = ground.points(at, numbers, effects), ground.reads()
    found = {}
    for name in bench.observables:
        values = np.array([value_in(result, answers[name]) for result in results])
        scale = even_scale(observables[name], values)
        z = to_scale(scale, values)
        good = np.isfinite(z)
        if good.sum() < LEAST_RUNS:
            raise SimulationStopped(few_values(name, int(good.sum()), results))
        known = Points(points.x[good], points.c[good], points.psi[good])
        found[name] = ObservableEmulator(ground, scale, fit_gaussian_process(known, z[good], reads))
    return found


def every_path(settings: Sequence[TrainingRun]) -> list[str]:
    """Dotted paths of conditions that some run states."""
    return list(dict.fromkeys(path for setting in settings for path in setting.at))


def few_values(name: str, count: int, results: Sequence[RunResult]) -> str:
    """Why there is no surface."""
    failures = [result.failure for result in results if result.failure]
    why = f"; {len(failures)} stopped, the first: {failures[0]}" if failures else ""
    return f"{name}: {count} of {len(results)} runs gave a value, {LEAST_RUNS} are needed{why}"


def even_scale(observable: Observable, values: Floats) -> Observable:
    """The comparison scale; the logarithm for an identity whose values all lie above 0."""
    known = values[np.isfinite(values)]
    if observable.transform != "identity" or not known.size or known.min() <= 0.0:
        return observable
    return Observable(observable.name, "log")


def rulers_of(
    rows: Sequence[Mapping[str, float]], accepted_paths: frozenset[str]
) -> dict[str, ConditionScale]:
    """Rulers of the conditions that vary and that the scene knows."""
    found: dict[str, ConditionScale] = {}
    seen: set[tuple[float, ...]] = set()
    for path in dict.fromkeys(path for row in rows for path in row):
        column = tuple(row.get(path, np.nan) for row in rows)
        values = np.array(sorted({value for value in column if isfinite(value)}))
        if values.size < 2 or path not in accepted_paths or column in seen:
            continue
        seen.add(column)  # one column of a table may set several paths
        logarithmic = bool(values[0] > 0.0 and values[-1] > LOG_SPAN * values[0])
        values = np.log(values) if logarithmic else values
        found[path] = ConditionScale(float(values.mean()), float(values.std()), logarithmic)
    return found
