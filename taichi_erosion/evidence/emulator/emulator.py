"""Emulator in place of scenes: one Gaussian process per observable, trained on a design of runs.

The statistics evaluate a model thousands of times, and a scene takes seconds for one. An emulator of some
hundred runs answers all of them without scatter; its own uncertainty enters every comparison.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from math import isfinite
from pathlib import Path

import numpy as np

from taichi_erosion.campaign.request import RunResult
from taichi_erosion.core.effect import STRENGTH
from taichi_erosion.core.effect_file import failures_of
from taichi_erosion.core.errors import SimulationStopped
from taichi_erosion.evidence.data.heap_correlation import shrink_correlation
from taichi_erosion.evidence.data.problem import (
    Candidate,
    Conditions,
    Floats,
    Integers,
    Numbers,
    Observable,
    QueryRows,
    Replicates,
    expected_strength,
    row_count,
)
from taichi_erosion.evidence.data.transforms import EFFECTS, Axis, axis_position, from_scale, slope, to_scale
from taichi_erosion.evidence.emulator import gaussian_process
from taichi_erosion.evidence.emulator.design import StudyScene, TrainingRun
from taichi_erosion.evidence.models import simulator
from taichi_erosion.evidence.models.predictor import AxisScale, axis_scale_of
from taichi_erosion.mechanisms.library import dose_position

LEAST_RUNS = 4  # with a value; fewer make no emulator
SMOOTH = 0.1  # variance of smooth parts over that of the scatter below which a contrast of runs shows scatter
Columns = Mapping[str, Floats]


def strength_position(strength: Floats) -> Floats:
    """Place 2 asinh(2 psi) [1] of a strength psi over the expected one, where effects change evenly.

    Linear below half of the expected strength, logarithmic above: effects saturate. On strengths themselves a
    kernel that is as smooth everywhere overshoots where the pull of necks no longer moves a heap.
    """
    return 2.0 * np.arcsinh(2.0 * strength)


@dataclass(frozen=True)
class EmulatorInputs:
    scene: StudyScene
    axes: tuple[Axis, ...]  # calibrated numbers that the scene accepts
    scales: Mapping[str, AxisScale]  # of conditions that vary, by dotted path
    candidates: tuple[Candidate, ...]
    mechanisms: tuple[str, ...] = ()  # whose doses are inputs, as far as there are runs with them
    factors: Mapping[str, str] = field(default_factory=dict)  # mechanism -> number of which it is a factor

    @property
    def names_of_effects(self) -> tuple[str, ...]:
        """Effects and mechanisms in the order of their inputs."""
        return (*(candidate.name for candidate in self.candidates), *self.mechanisms)

    def standardise(
        self, size: int, at: Conditions, parameters: Columns, effects: Columns
    ) -> gaussian_process.Points:
        """Standardised inputs of rows; everything is a column; a factor of a number is that number."""
        none = np.full(size, np.nan)
        conditions, values = at or {"": none}, dict(parameters)
        for name, path in self.factors.items():
            values[path] = values[path] * (1.0 + np.asarray(effects.get(name, 0.0)))
        x = [[axis_position(axis, float(v)) for v in values[axis.name]] for axis in self.axes]
        c = [scale(conditions.get(path, none)) for path, scale in self.scales.items()]
        acting = {name: np.broadcast_to(effects.get(name, 0.0), size) for name in self.names_of_effects}
        psi = [self.strength(each, conditions, parameters, acting[each.name]) for each in self.candidates]
        psi += [dose_position(acting[name]) for name in self.mechanisms]
        return gaussian_process.Points(
            *(np.array(part, dtype=float).reshape(-1, size).T for part in (x, c, psi))
        )

    def strength(self, candidate: Candidate, at: Conditions, parameters: Columns, psi: Floats) -> Floats:
        """Place of strength over the expected one, times the effect's dose; 0 where the effect cannot act."""
        if not psi.any():
            return np.zeros(psi.size)
        effect, scene = self.scene.simulator.library[candidate.name], self.scene.measure.scene
        conditions = self.scene.simulator.stated_columns(at, scene)
        prefix = f"{EFFECTS}{effect.name}."
        values = {path.removeprefix(prefix): v for path, v in parameters.items() if path.startswith(prefix)}
        numbers = {**self.scene.simulator.scene_numbers_of(scene, effect.name), **values}
        params = effect.params(**{name: value for name, value in numbers.items() if name != STRENGTH})
        with failures_of(effect, "dose"):
            dose = np.where(effect.can_act(conditions), effect.dose(params, conditions), 0.0)
        return strength_position(psi / expected_strength(candidate) * dose)

    def active_inputs(self) -> gaussian_process.ActiveInputs:
        """Which conditions and calibrated numbers enter the bare model, and which every effect."""
        library = self.scene.simulator.library
        bare = self.scene.simulator.effects_acting_in_scene(self.scene.measure.scene)
        conditions, numbers = list[list[bool]](), list[list[bool]]()
        for present in (bare, *({*bare, name} for name in self.names_of_effects)):
            read = {name for effect in present for name in library[effect].reads}
            conditions.append([simulator.condition_matters(path, read) for path in self.scales])
            numbers.append([simulator.parameter_can_change_run(axis.name, present) for axis in self.axes])
        return gaussian_process.ActiveInputs(np.array(conditions, bool), np.array(numbers, bool))


@dataclass(frozen=True)
class ObservableEmulator:
    inputs: EmulatorInputs
    scale: Observable  # on which its noise is even; the logarithm of anything above 0
    process: gaussian_process.GaussianProcess
    run_sd: float  # of the value of one run, on the comparison scale
    run_numbers: Integers  # runs of its scene that gave a value, in the order of the process


@dataclass(frozen=True)
class Emulator:
    """A model made of emulators by observable; its values do not depend on the seed."""

    emulators: Mapping[str, ObservableEmulator]

    def __call__(
        self, observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
    ) -> Floats:
        """Predictions [seed, row]."""
        emulator = self.emulators[observable]
        mean = emulator.process.mean(inputs_of_request(emulator.inputs, conditions, parameters, effects))
        return np.tile(from_scale(emulator.scale, mean), (len(seeds), 1))

    @cached_property
    def joint_errors_by_scene(self) -> dict[Path, tuple[tuple[str, ...], gaussian_process.JointErrors]]:
        """Observables of every scene, and the errors that their emulators share."""
        by_scene: dict[Path, list[str]] = {}
        for name, each in self.emulators.items():
            by_scene.setdefault(each.inputs.scene.measure.scene, []).append(name)
        errors = {}
        for scene, names in by_scene.items():
            emulators = [self.emulators[name] for name in names]
            numbers = [each.run_numbers for each in emulators]
            joint = gaussian_process.joint_errors([each.process for each in emulators], numbers)
            errors[scene] = (tuple(names), joint)
        return errors

    def error_covariance(self, queries: Sequence[QueryRows], parameters: Numbers, effects: Numbers) -> Floats:
        """Covariance of the emulators' own errors over rows of observables, on the comparison scale."""
        places, points, steepness = dict[Path, list[int]](), list[gaussian_process.Points](), list[Floats]()
        for place, (observable, conditions, doses) in enumerate(queries):
            emulator = self.emulators[observable.name]
            places.setdefault(emulator.inputs.scene.measure.scene, []).append(place)
            points.append(inputs_of_request(emulator.inputs, conditions, parameters, {**effects, **doses}))
            value = from_scale(emulator.scale, emulator.process.mean(points[-1]))
            steepness.append(slope(observable, value) / slope(emulator.scale, value))
        rows = gaussian_process.consecutive_slices([each.size for each in steepness])
        whole = np.zeros((rows[-1].stop,) * 2)
        for scene, indices in places.items():
            names, joint = self.joint_errors_by_scene[scene]
            chosen = [(names.index(queries[place][0].name), points[place]) for place in indices]
            at = np.concatenate([np.arange(rows[place].start, rows[place].stop) for place in indices])
            whole[np.ix_(at, at)] = joint.joint_error_covariance(chosen)
        return whole * np.outer(*[np.concatenate(steepness)] * 2)


def inputs_of_request(
    inputs: EmulatorInputs,
    conditions: Conditions,
    parameters: Mapping[str, float],
    effects: Mapping[str, float | Floats],
) -> gaussian_process.Points:
    """Inputs of a request, in which numbers are the same for all rows; so are strengths, but for doses."""
    rows = row_count(conditions)
    at = {path: column for name, column in conditions.items() for path in simulator.dotted_paths(name)}
    numbers = {axis.name: np.full(rows, parameters[axis.name]) for axis in inputs.axes}
    strengths = {name: np.broadcast_to(each, rows) for name, each in effects.items() if np.any(each)}
    return inputs.standardise(rows, at, numbers, strengths)


def fit_emulators(
    inputs: EmulatorInputs,
    trained: Sequence[tuple[TrainingRun, RunResult]],
    observables: Mapping[str, Observable],
) -> dict[str, ObservableEmulator]:
    """Emulators of all observables of one scene; raises SimulationStopped where too few runs have a value."""
    runs, results = [run for run, _ in trained], [result for _, result in trained]
    paths = dict.fromkeys(path for run in runs for path in run.at)
    at = {path: np.array([run.at.get(path, np.nan) for run in runs]) for path in paths}
    numbers = {axis.name: np.array([run.parameters[axis.name] for run in runs]) for axis in inputs.axes}
    names = (*inputs.names_of_effects, *inputs.factors)
    effects = {name: np.array([run.effects.get(name, 0.0) for run in runs]) for name in names}
    points = inputs.standardise(len(runs), at, numbers, effects)
    emulators = {}
    for name in inputs.scene.observables:
        measure = inputs.scene.simulator.measures[name]
        values = np.array([simulator.study_value(result, measure) for result in results])
        scale, finite = observables[name], values[np.isfinite(values)]
        if scale.transform == "identity" and finite.size and finite.min() > 0.0:
            scale = Observable(name, "log")
        z = to_scale(scale, values)
        good = np.isfinite(z)
        if good.sum() < LEAST_RUNS:
            failures = [result.failure for result in results if result.failure]
            why = f"; {len(failures)} stopped, the first: {failures[0]}" if failures else ""
            count = f"{good.sum()} of {len(results)} runs gave a value"
            raise SimulationStopped(f"{name}: {count}, {LEAST_RUNS} are needed{why}")
        training = gaussian_process.Points(points.x[good], points.c[good], points.psi[good])
        process = gaussian_process.fit_gaussian_process(training, z[good], inputs.active_inputs())
        typical = np.median(values[good], keepdims=True)
        run_sd = process.scatter * float((slope(observables[name], typical) / slope(scale, typical))[0])
        emulators[name] = ObservableEmulator(inputs, scale, process, run_sd, np.flatnonzero(good))
    return emulators


def replicate_scatter(emulators: Mapping[str, ObservableEmulator]) -> Replicates | None:
    """Scatter of single runs, and its correlation among the observables of one scene.

    None where no two observables are seen to be correlated.
    """
    names = tuple(emulators)
    correlation, freedom = np.eye(len(names)), np.zeros((len(names),) * 2)
    for a, b in combinations(range(len(names)), 2):
        one, other = emulators[names[a]], emulators[names[b]]
        if one.inputs.scene is other.inputs.scene:
            correlation[a, b], freedom[a, b] = scatter_correlation(one, other)
            correlation[b, a], freedom[b, a] = correlation[a, b], freedom[a, b]
    matrix = shrink_correlation(correlation, freedom)
    if np.array_equal(matrix, np.eye(len(names))):
        return None
    return Replicates(names, np.array([each.run_sd for each in emulators.values()]), matrix)


def scatter_correlation(one: ObservableEmulator, other: ObservableEmulator) -> tuple[float, float]:
    """Correlation of the scatter of runs that gave both values, and its degrees of freedom.

    Of contrasts of runs only those count in which the smooth parts of both observables have less than SMOOTH
    of the variance of the scatter: the error of an emulator between runs is no scatter.
    """
    _, first, second = np.intersect1d(one.run_numbers, other.run_numbers, return_indices=True)
    smooth, values = np.zeros((first.size, first.size)), list[Floats]()
    for process, at in ((one.process, first), (other.process, second)):
        covariance = process.factor @ process.factor.T
        smooth += covariance[np.ix_(at, at)] / process.amplitude[-1] ** 2 - np.eye(at.size)
        values.append((covariance @ process.weights)[at])
    share, contrasts = np.linalg.eigh(smooth)
    a, b = (contrasts[:, share < SMOOTH].T @ value for value in values)
    energy = float((a @ a) * (b @ b))
    return (float(a @ b) / np.sqrt(energy) if energy > 0.0 else 0.0), float(a.size)


def axis_scales(rows: Sequence[Mapping[str, float]], accepted: frozenset[str]) -> dict[str, AxisScale]:
    """Scales of the conditions that vary and that the scene accepts."""
    scales: dict[str, AxisScale] = {}
    columns: set[tuple[float, ...]] = set()
    for path in dict.fromkeys(path for row in rows for path in row):
        column = tuple(row.get(path, np.nan) for row in rows)
        scale = axis_scale_of(np.array(sorted({value for value in column if isfinite(value)})))
        if scale is None or path not in accepted or column in columns:
            continue
        columns.add(column)  # one column of a table may set several paths
        middle = float(np.exp(scale.centre)) if scale.logarithmic else scale.centre
        scales[path] = replace(scale, middle=middle)
    return scales
