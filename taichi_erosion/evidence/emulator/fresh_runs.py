"""Fresh runs: simulations at fitted numbers with seeds that no fit has used, and the emulator beside them.

An emulator finds its answer where it is itself most optimistic: among many explanations the one that fits
best by an error of the emulator is named. Runs at exactly these numbers know nothing of that error. With y_pr
the value of run r at point p, on the scale of the emulator, m_p its prediction there, and n points,

    d_p = mean_r y_pr - m_p,    C = C_emulator + diag(s^2 / R_p),    F = d^T C^-1 d / n ~ F(n, nu)

The scatter s of one run is pooled over all points with that of the training runs, which counts as nu_0 runs;
the observables of one run share it: S = (nu_0 diag(s_0^2) + sum r r^T) / nu, nu = nu_0 + runs - points.

Reference: Bastos & O'Hagan (2009), Technometrics 51, 425 (diagnostics for Gaussian process emulators).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import special

from taichi_erosion.campaign.request import RunRequest, RunResult, request_of_scene
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import Conditions, Floats, Integers, Numbers, Observable, Progress
from taichi_erosion.evidence.data.transforms import from_scale, slope, to_scale
from taichi_erosion.evidence.emulator.design import Setting, StudyScene, design_seed, distinct_conditions
from taichi_erosion.evidence.emulator.emulator import Emulator, ObservableEmulator, inputs_of_request
from taichi_erosion.evidence.emulator.training_runs import TrainingRuns, execute_requests, runs_left_by_cap
from taichi_erosion.evidence.models.plugin import NameMapping
from taichi_erosion.evidence.models.predictor import PRIOR_FREEDOM, mean_over_finite_seeds
from taichi_erosion.evidence.models.simulator import SceneMeasure, row_at, study_value
from taichi_erosion.evidence.record import GapPart

SETTINGS = 3  # the explanation that is told, its runner-up, the bare model
MOST_SETS = 12  # sets of conditions of one scene at which an answer is tested

Request = tuple[Observable, Integers, Conditions]  # of a predictor: observable, its rows, their conditions
Point = tuple[Path, tuple[str, ...]]  # a scene with all that is set in it
RunScatter = tuple[Floats, float]  # of one run of a scene, on the emulators' scales: covariance, freedom
Readings = Mapping[Point, Floats]  # (seeds, observables of the scene), on the emulators' scales


@dataclass(frozen=True)
class FreshRuns:
    """Fresh runs of one setting, on the comparison scale."""

    values: Floats  # (seeds, n); NaN where a row was not simulated or a run has no value
    columns: Floats  # (n, q), errors of one sd of the mean over seeds, which rows of one run share
    tests: Mapping[str, GapPart]  # of the emulator, by observable

    @property
    def row_means(self) -> Floats:
        return mean_over_finite_seeds(self.values)

    def merge_fresh_runs(self, other: "FreshRuns", rows: Integers) -> "FreshRuns":
        """These runs with others in their place in some rows."""
        q, more = self.columns.shape[1], max(len(other.values) - len(self.values), 0)
        values = np.pad(self.values, ((0, more), (0, 0)), constant_values=np.nan)
        values[:, rows] = np.nan
        values[: len(other.values), rows] = other.values
        columns = np.hstack([self.columns, np.zeros((values.shape[1], other.columns.shape[1]))])
        columns[rows, :q], columns[rows, q:] = 0.0, other.columns
        return FreshRuns(values, columns, self.tests)


@dataclass(frozen=True)
class FreshCampaign:
    """Fresh runs of some settings, or how many would be needed where the budget has no room for them."""

    runs: tuple[FreshRuns, ...]
    keys: frozenset[str]  # of the runs in the ledger
    seeds: int  # of every set of conditions; 0: no room
    failures: int = 0


@dataclass(frozen=True)
class TestedRow:
    row: int
    observable: Observable
    place: int  # of the observable among those of its scene
    emulator: ObservableEmulator
    measure: SceneMeasure
    at: Numbers  # conditions by dotted path
    by_name: Numbers  # likewise by name

    def point(self, setting: Setting) -> Point:
        """What is simulated for it; rows that differ in nothing that a run reads share a point."""
        simulator = self.emulator.inputs.scene.simulator
        words = simulator.overrides(self.measure, self.at, setting.parameters, setting.at(self.at)[0])
        return self.measure.scene, words


@dataclass(frozen=True)
class FreshSimulator:
    """Scenes of a study beside the emulators that were trained on them."""

    training: TrainingRuns
    mapping: NameMapping  # of the study's names, onto the emulators
    stored_keys: frozenset[str]  # keys of fresh runs that were made already
    seeds: int  # of every set of conditions

    def simulate_settings(
        self,
        settings: Sequence[Setting],
        requests: Sequence[Request],
        weight: Floats,
        progress: Progress,
        times: int = 1,
    ) -> FreshCampaign:
        """Runs of all settings at the conditions whose rows weigh most; so many times the usual seeds."""
        rows = self.rows_of_largest_weight(requests, weight)
        points = list(dict.fromkeys(row.point(setting) for setting in settings for row in rows))
        keys = frozenset[str]()
        for seeds in range(times * self.seeds, 0, -1):
            flat = [(point, request) for point in points for request in self.point_runs(point, seeds)]
            keys = frozenset(request.key for _, request in flat)
            if len(keys - self.stored_keys) <= runs_left_by_cap(self.training):
                results = execute_requests(self.training, [request for _, request in flat], progress)
                results_by_point: dict[Point, list[RunResult]] = {point: [] for point in points}
                for (point, _), result in zip(flat, results, strict=True):
                    results_by_point[point].append(result)
                failed = sum(bool(result.failure) for result in results)
                scenes = {scene.measure.scene: scene for scene in self.training.scenes}
                readings = {p: self.seed_values(scenes[p[0]], r, seeds) for p, r in results_by_point.items()}
                scatter = {path: self.pooled_run_scatter(scene, readings) for path, scene in scenes.items()}
                by_setting = (SettingRows(each, rows, readings, scatter) for each in settings)
                runs = tuple(each.fresh_runs_of_setting((seeds, weight.size)) for each in by_setting)
                return FreshCampaign(runs, keys, seeds, failed)
        return FreshCampaign((), keys, 0)

    def rows_of_largest_weight(self, requests: Sequence[Request], weight: Floats) -> list[TestedRow]:
        """Rows of the sets of conditions that weigh most, `MOST_SETS` of every scene, as asked."""
        groups: dict[Path, dict[tuple[tuple[str, float], ...], list[int]]] = {}
        tested: list[TestedRow] = []
        for observable, rows, conditions in requests:
            name = self.mapping.observables[observable.name]
            columns, emulator = self.mapping.model_conditions(conditions), self.emulators[name]
            scene = emulator.inputs.scene
            group, place = groups.setdefault(scene.measure.scene, {}), scene.observables.index(name)
            for k, row in enumerate(map(int, rows)):
                at, measure = row_at(columns, k), scene.simulator.measures[name]
                by_name = {key: float(each[k]) for key, each in conditions.items() if np.isfinite(each[k])}
                tested.append(TestedRow(row, observable, place, emulator, measure, at, by_name))
                group.setdefault(tuple(sorted(at.items())), []).append(row)
        ranked = (sorted(g.values(), key=lambda rows: -float(weight[rows].sum())) for g in groups.values())
        chosen = {row for sets in ranked for rows in sets[:MOST_SETS] for row in rows}
        return [each for each in tested if each.row in chosen]

    def point_runs(self, point: Point, seeds: int) -> list[RunRequest]:
        """Runs of one point; their seeds follow from it. None where the scene refuses it."""
        scene, words = point
        key = f"{self.training.study.fresh}fresh|{scene.name}|{'|'.join(words)}"
        simulator, device = self.training.simulator, self.training.simulator.device
        try:
            built = simulator.load_scene_at(scene, words)
            return [request_of_scene(built, design_seed(key, n), device=device) for n in range(seeds)]
        except BadInput:
            return []

    def seed_values(self, scene: StudyScene, results: Sequence[RunResult], seeds: int) -> Floats:
        """Values of all observables of a scene, seed by seed; NaN where a run has none."""
        table = np.full((seeds, len(scene.observables)), np.nan)
        for index, name in enumerate(scene.observables):
            values = np.array([study_value(each, scene.simulator.measures[name]) for each in results])
            table[: values.size, index] = to_scale(self.emulators[name].scale, values)
        return np.where(np.isfinite(table), table, np.nan)

    def pooled_run_scatter(self, scene: StudyScene, readings: Readings) -> RunScatter:
        """Scatter of one run, pooled over the points of a scene with that of its training runs."""
        sd = np.array([self.emulators[name].process.scatter for name in scene.observables])
        total, freedom = PRIOR_FREEDOM * np.diag(sd**2), PRIOR_FREEDOM
        for point, values in readings.items():
            whole = values[np.isfinite(values).all(axis=1)]
            if point[0] == scene.measure.scene and whole.shape[0] > 1:
                centred = whole - whole.mean(axis=0)
                total, freedom = total + centred.T @ centred, freedom + whole.shape[0] - 1
        return total / freedom, freedom

    @property
    def emulators(self) -> Mapping[str, ObservableEmulator]:
        assert isinstance(self.mapping.model, Emulator)
        return self.mapping.model.emulators


def most_test_runs(training: TrainingRuns, seeds: int) -> int:
    """Most runs that the test of an answer takes: those of the bare model do not depend on all conditions."""
    count = 0
    for scene in training.scenes:
        bare = min(len(distinct_conditions(scene, ())), MOST_SETS)
        count += bare + (SETTINGS - 1) * min(len(scene.rows), MOST_SETS)
    return count * seeds


@dataclass(frozen=True)
class SettingRows:
    """Rows at one setting, with what was simulated for them."""

    setting: Setting
    rows: Sequence[TestedRow]
    readings: Readings
    scatter: Mapping[Path, RunScatter]

    def fresh_runs_of_setting(self, shape: tuple[int, int]) -> FreshRuns:
        """All rows on the comparison scale, and the test of every observable."""
        points = list(dict.fromkeys(row.point(self.setting) for row in self.rows))
        most = max((covariance.shape[0] for covariance, _ in self.scatter.values()), default=1)
        values, columns = np.full(shape, np.nan), np.zeros((shape[1], len(points), most))
        for each in self.rows:
            readings, errors = self.values_and_errors_of_row(each)
            scale = each.emulator.scale
            values[:, each.row] = to_scale(each.observable, from_scale(scale, readings))
            mean = from_scale(scale, mean_over_finite_seeds(readings[:, np.newaxis]))
            steepness = np.nan_to_num(slope(each.observable, mean) / slope(scale, mean))
            columns[each.row, points.index(each.point(self.setting)), : errors.size] = errors * steepness
        names = dict.fromkeys(each.observable.name for each in self.rows)
        tests = {name: self.gap_test([r for r in self.rows if r.observable.name == name]) for name in names}
        tests_by_name = {name: test for name, test in tests.items() if test is not None}
        return FreshRuns(values, columns.reshape(shape[1], -1), tests_by_name)

    def values_and_errors_of_row(self, row: TestedRow) -> tuple[Floats, Floats]:
        """Values (seeds,) of a row, and errors of one sd of their mean (observables of its scene,)."""
        point = row.point(self.setting)
        readings = self.readings[point][:, row.place]
        covariance, _ = self.scatter[point[0]]
        errors = np.linalg.cholesky(covariance)[row.place]
        return readings, errors / np.sqrt(max(int(np.isfinite(readings).sum()), 1))

    def gap_test(self, rows: Sequence[TestedRow]) -> GapPart | None:
        """Whether the emulator of one observable is off by more than its stated error; None without runs."""
        first: dict[Point, TestedRow] = {}
        for row in rows:
            if np.isfinite(self.values_and_errors_of_row(row)[0]).any():
                first.setdefault(row.point(self.setting), row)
        if not first:
            return None
        tested, emulator = list(first.values()), rows[0].emulator
        at = {path: np.array([row.at[path] for row in tested]) for path in tested[0].at}
        acting = [self.setting.at(row.at)[0] for row in tested]
        effects = {name: np.array([each[name] for each in acting]) for name in acting[0]}
        inputs = inputs_of_request(emulator.inputs, at, self.setting.parameters, effects)
        pairs = [self.values_and_errors_of_row(row) for row in tested]
        mean = np.array([mean_over_finite_seeds(deviation[:, np.newaxis])[0] for deviation, _ in pairs])
        error = np.array([float(np.linalg.norm(errors)) for _, errors in pairs])
        emulated, own_sd = emulator.process.mean(inputs), emulator.process.error_cov(inputs)
        gap, total = mean - emulated, own_sd + np.diag(error**2)
        statistic = float(gap @ np.linalg.solve(total, gap)) / gap.size
        _, freedom = self.scatter[tested[0].measure.scene]
        p = float(special.fdtrc(gap.size, freedom, statistic))
        worst = int(np.argmax(np.abs(gap) / np.sqrt(np.diag(total))))
        sizes = from_scale(emulator.scale, np.array([emulated[worst], mean[worst]]))
        sd = np.array([np.sqrt(max(own_sd[worst, worst], 0.0)), error[worst]]) / slope(emulator.scale, sizes)
        numbers, row = map(float, (sizes[0], sd[0], sizes[1], sd[1])), tested[worst]
        return GapPart((), row.observable.name, row.by_name, *numbers, p=p)
