"""Fresh runs: simulations at fitted numbers with seeds that no fit has used, and the emulator beside them.

An emulator finds its answer where it is itself most optimistic: among many explanations the one that fits
best by an error of the emulator is named. Runs at exactly these numbers know nothing of that error. With y_pr
the value of run r at point p, on the scale of the emulator, m_p its prediction there, and n points,

    d_p = mean_r y_pr - m_p,    C = C_emulator + diag(s^2 / R_p),    F = d^T C^-1 d / n ~ F(n, nu)

The scatter s of one run is pooled over all points with that of the training runs, which counts as nu_0 runs;
the observables of one run share it: S = (nu_0 diag(s_0^2) + sum r r^T) / nu, nu = nu_0 + runs - points.

Reference: Bastos & O'Hagan (2009), Technometrics 51, 425 (diagnostics for Gaussian process emulators).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import stats

from taichi_erosion.campaign.request import RunRequest, RunResult, request_of
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import Conditions, Floats, Integers, Numbers, Observable, Progress
from taichi_erosion.evidence.data.transforms import from_scale, slope, to_scale
from taichi_erosion.evidence.emulator.design import StudyScene, distinct_conditions, rounded, seed_of
from taichi_erosion.evidence.emulator.emulator import Emulator, ObservableEmulator, request_points
from taichi_erosion.evidence.emulator.training_runs import TrainingRuns, executed, room_left
from taichi_erosion.evidence.models.plugin import NameMapping
from taichi_erosion.evidence.models.predictor import PRIOR_FREEDOM, seed_mean
from taichi_erosion.evidence.models.simulator import dotted_paths, value_in_unit

SETTINGS = 3  # the explanation that is told, its runner-up, the bare model
MOST_CONDITIONS = 12  # sets of conditions of one scene at which an answer is tested

Request = tuple[Observable, Integers, Conditions]  # of a predictor: observable, its rows, their conditions
Point = tuple[Path, tuple[str, ...]]  # a scene with all that is set in it
Readings = Mapping[Point, Floats]  # (seeds, observables of the scene), on the emulators' scales


@dataclass(frozen=True)
class Setting:
    """Calibrated numbers and strengths of one explanation."""

    parameters: Numbers
    effects: Numbers


@dataclass(frozen=True)
class GapTest:
    """Fresh runs against the emulator of one observable, in its unit."""

    p: float  # of as large gaps at all points if the stated errors are right
    row: int  # where the gap is largest
    emulated: float
    emulated_sd: float
    simulated: float
    simulated_sd: float


@dataclass(frozen=True)
class FreshRuns:
    """Fresh runs of one setting, on the comparison scale."""

    values: Floats  # (seeds, n); NaN where a row was not simulated or a run has no value
    columns: Floats  # (n, q), errors of one sd of the mean over seeds, which rows of one run share
    tests: Mapping[str, GapTest]  # by observable

    @property
    def mean(self) -> Floats:
        """Mean over the seeds (n,)."""
        return seed_mean(self.values)


@dataclass(frozen=True)
class FreshCampaign:
    """Fresh runs of some settings, or how many would be needed where the budget has no room for them."""

    runs: tuple[FreshRuns, ...]
    keys: frozenset[str]  # of the runs in the ledger
    seeds: int  # of every set of conditions; 0: no room
    failed: int = 0


@dataclass(frozen=True)
class SceneScatter:
    """Scatter of one run of a scene, on the emulators' scales."""

    covariance: Floats  # (observables, observables)
    freedom: float


@dataclass(frozen=True)
class FreshSimulator:
    """Scenes of a study beside the emulators that were trained on them."""

    training: TrainingRuns
    mapping: NameMapping  # of the study's names, onto the emulators
    known: frozenset[str]  # keys of fresh runs that were made already
    seeds: int  # of every set of conditions

    def emulator(self, observable: Observable) -> ObservableEmulator:
        """Emulator of one observable."""
        return emulators_of(self)[self.mapping.observables[observable.name]]

    def simulate(
        self, settings: Sequence[Setting], asked: Sequence[Request], weight: Floats, progress: Progress
    ) -> FreshCampaign:
        """Runs of all settings at the conditions whose rows weigh most."""
        known = [(observable, rows, self.mapping.known(at)) for observable, rows, at in asked]
        settings = [  # without meaningless digits, which would make it another run elsewhere
            Setting(
                {path: rounded(value) for path, value in each.parameters.items()},
                {name: rounded(value) for name, value in each.effects.items() if value > 0.0},
            )
            for each in settings
        ]
        chosen = weighty_rows(self, known, weight)
        places = [placed(self, each, known, chosen) for each in settings]
        points = list(dict.fromkeys(point for place in places for point in place.values()))
        keys = frozenset[str]()
        for seeds in range(self.seeds, 0, -1):
            fresh = replace(self, seeds=seeds)
            requests = {point: point_requests(fresh, point) for point in points}
            keys = frozenset(request.key for each in requests.values() for request in each)
            if len(keys - self.known) <= room_left(self.training):
                found = simulated(fresh, requests, progress)
                told = setting_runs(fresh, zip(settings, places, strict=True), known, found, weight.size)
                failed = sum(bool(result.failure) for each in found.values() for result in each)
                return FreshCampaign(told, keys, seeds, failed)
        return FreshCampaign((), keys, 0)


def setting_runs(
    fresh: FreshSimulator,
    placed_settings: Iterable[tuple[Setting, Mapping[int, Point]]],
    asked: Sequence[Request],
    found: Mapping[Point, Sequence[RunResult]],
    size: int,
) -> tuple[FreshRuns, ...]:
    """Results of a campaign as rows of every setting."""
    readings = {point: readings_of(fresh, point, results) for point, results in found.items()}
    scatter = {scene.measure.scene: scene_scatter(fresh, scene, readings) for scene in fresh.training.scenes}
    return tuple(
        SettingRows(fresh, setting, place, readings, scatter, size).runs(asked)
        for setting, place in placed_settings
    )


def fresh_count(training: TrainingRuns, seeds: int) -> int:
    """Most runs that the test of an answer takes: those of the bare model do not depend on all conditions."""
    count = 0
    for scene in training.scenes:
        bare = min(len(distinct_conditions(scene, ())), MOST_CONDITIONS)
        count += bare + (SETTINGS - 1) * min(len(scene.rows), MOST_CONDITIONS)
    return count * seeds


def conditions_at(conditions: Conditions, place: int) -> Numbers:
    """Conditions of one row by dotted path."""
    return {path: float(column[place]) for name, column in conditions.items() for path in dotted_paths(name)}


def weighty_rows(fresh: FreshSimulator, asked: Sequence[Request], weight: Floats) -> set[int]:
    """Rows of the sets of conditions that weigh most, `MOST_CONDITIONS` of every scene."""
    groups: dict[Path, dict[tuple[tuple[str, float], ...], list[int]]] = {}
    for observable, rows, conditions in asked:
        own = groups.setdefault(fresh.emulator(observable).inputs.scene.measure.scene, {})
        for place, row in enumerate(rows):
            own.setdefault(tuple(sorted(conditions_at(conditions, place).items())), []).append(int(row))
    chosen: set[int] = set()
    for own in groups.values():
        ranked = sorted(own.values(), key=lambda rows: -float(weight[rows].sum()))
        chosen |= {row for rows in ranked[:MOST_CONDITIONS] for row in rows}
    return chosen


def placed(
    fresh: FreshSimulator, setting: Setting, asked: Sequence[Request], chosen: set[int]
) -> dict[int, Point]:
    """Point of every chosen row at one setting; rows that differ in nothing that a run reads share one."""
    places: dict[int, Point] = {}
    for observable, rows, conditions in asked:
        scene = fresh.emulator(observable).inputs.scene
        measure = scene.simulator.measures[fresh.mapping.observables[observable.name]]
        for place, row in enumerate(rows):
            if int(row) in chosen:
                at = conditions_at(conditions, place)
                words = scene.simulator.overrides(measure, at, setting.parameters, setting.effects)
                places[int(row)] = (measure.scene, words)
    return places


def simulated(
    fresh: FreshSimulator, requests: Mapping[Point, list[RunRequest]], progress: Progress
) -> dict[Point, list[RunResult]]:
    """Results at every point, in one campaign; none where the scene refuses a point."""
    flat = [(point, request) for point, each in requests.items() for request in each]
    results = executed(fresh.training, [request for _, request in flat], progress)
    found: dict[Point, list[RunResult]] = {point: [] for point in requests}
    for (point, _), result in zip(flat, results, strict=True):
        found[point].append(result)
    return found


def point_requests(fresh: FreshSimulator, point: Point) -> list[RunRequest]:
    """Runs of one point; their seeds follow from it, and no design draws them."""
    scene, words = point
    key = f"{fresh.training.study.fresh}fresh|{scene.name}|{'|'.join(words)}"
    try:
        built = fresh.training.simulator.scene(scene, words)
        return [request_of(built, seed_of(key, number)) for number in range(fresh.seeds)]
    except BadInput:
        return []


def readings_of(fresh: FreshSimulator, point: Point, results: Sequence[RunResult]) -> Floats:
    """Values of all observables of a scene, seed by seed; NaN where a run has none."""
    scene = next(each for each in fresh.training.scenes if each.measure.scene == point[0])
    found = np.full((fresh.seeds, len(scene.observables)), np.nan)
    for index, name in enumerate(scene.observables):
        measure = scene.simulator.measures[name]
        values = np.array([value_in_unit(result, measure) for result in results])
        scale = emulators_of(fresh)[name].scale
        found[: values.size, index] = to_scale(scale, values)
    return np.where(np.isfinite(found), found, np.nan)


def emulators_of(fresh: FreshSimulator) -> Mapping[str, ObservableEmulator]:
    """Emulators by the simulator's names."""
    assert isinstance(fresh.mapping.model, Emulator)
    return fresh.mapping.model.emulators


def scene_scatter(fresh: FreshSimulator, scene: StudyScene, readings: Readings) -> SceneScatter:
    """Scatter of one run, pooled over the points of a scene with that of its training runs."""
    emulators = [emulators_of(fresh)[name] for name in scene.observables]
    known = np.array([each.process.amplitude[-1] * each.process.width for each in emulators])
    total, freedom = PRIOR_FREEDOM * np.diag(known**2), PRIOR_FREEDOM
    for point, values in readings.items():
        whole = values[np.isfinite(values).all(axis=1)]
        if point[0] == scene.measure.scene and whole.shape[0] > 1:
            centred = whole - whole.mean(axis=0)
            total, freedom = total + centred.T @ centred, freedom + whole.shape[0] - 1
    return SceneScatter(total / freedom, freedom)


@dataclass(frozen=True)
class SettingRows:
    """Rows of a study at one setting, with the points that were simulated for them."""

    fresh: FreshSimulator
    setting: Setting
    places: Mapping[int, Point]
    readings: Readings
    scatter: Mapping[Path, SceneScatter]
    size: int

    def runs(self, asked: Sequence[Request]) -> FreshRuns:
        """All rows on the comparison scale, and the test of every observable."""
        values = np.full((self.fresh.seeds, self.size), np.nan)
        points = list(dict.fromkeys(self.places.values()))
        most = max((each.covariance.shape[0] for each in self.scatter.values()), default=1)
        columns = np.zeros((self.size, len(points), most))
        tests = {}
        for observable, rows, conditions in asked:
            found = self.fresh.emulator(observable)
            chosen = [k for k, row in enumerate(rows) if int(row) in self.places]
            for row in (int(rows[k]) for k in chosen):
                point = self.places[row]
                own, errors = self.reading(observable, point)
                values[:, row] = to_scale(observable, from_scale(found.scale, own))
                columns[row, points.index(point), : errors.size] = errors * steepness(observable, found, own)
            test = self.test(observable, rows[chosen], {n: c[chosen] for n, c in conditions.items()})
            tests |= {} if test is None else {observable.name: test}
        return FreshRuns(values, columns.reshape(self.size, -1), tests)

    def reading(self, observable: Observable, point: Point) -> tuple[Floats, Floats]:
        """Values (seeds,) of an observable at a point, and errors of one sd of their mean (observables,)."""
        scatter = self.scatter[point[0]]
        names = self.fresh.emulator(observable).inputs.scene.observables
        index = names.index(self.fresh.mapping.observables[observable.name])
        own = self.readings[point][:, index]
        errors = np.linalg.cholesky(scatter.covariance)[index]
        return own, errors / np.sqrt(max(int(np.isfinite(own).sum()), 1))

    def test(self, observable: Observable, rows: Integers, conditions: Conditions) -> GapTest | None:
        """Whether the emulator of one observable is off by more than its stated error; None without runs."""
        first: dict[Point, int] = {}
        for place, row in enumerate(rows):
            own, _ = self.reading(observable, self.places[int(row)])
            if np.isfinite(own).any():
                first.setdefault(self.places[int(row)], place)
        if not first:
            return None
        found, kept = self.fresh.emulator(observable), list(first.values())
        at = {name: column[kept] for name, column in conditions.items()}
        inputs = request_points(found.inputs, at, self.setting.parameters, self.setting.effects)
        pairs = [self.reading(observable, point) for point in first]
        mean = np.array([seed_mean(own[:, np.newaxis])[0] for own, _ in pairs])
        error = np.array([float(np.linalg.norm(errors)) for _, errors in pairs])
        emulated, own = found.process.mean(inputs), found.process.uncertainty(inputs)
        gap, total = mean - emulated, own + np.diag(error**2)
        statistic = float(gap @ np.linalg.solve(total, gap)) / gap.size
        scene = found.inputs.scene.measure.scene
        p = float(stats.f.sf(statistic, gap.size, self.scatter[scene].freedom))
        worst = int(np.argmax(np.abs(gap) / np.sqrt(np.diag(total))))
        sizes = np.array([np.sqrt(max(own[worst, worst], 0.0)), error[worst]])
        (told, told_sd), (got, got_sd) = (
            in_unit(found, value, sd) for value, sd in zip((emulated[worst], mean[worst]), sizes, strict=True)
        )
        return GapTest(p, int(rows[kept[worst]]), told, told_sd, got, got_sd)


def steepness(observable: Observable, found: ObservableEmulator, own: Floats) -> float:
    """Change of the comparison scale per unit of the emulator's, at the mean of some values."""
    value = from_scale(found.scale, seed_mean(own[:, np.newaxis]))
    return float(np.nan_to_num(slope(observable, value) / slope(found.scale, value))[0])


def in_unit(found: ObservableEmulator, value: float, sd: float) -> tuple[float, float]:
    """A value of the emulator's scale with its sd, in the unit of the observable."""
    told = from_scale(found.scale, np.array([value]))
    return float(told[0]), float(sd / slope(found.scale, told)[0])
