"""Training runs of a study that scenes answer: planned, executed or found in the ledger, and emulated.

The first design follows from the study alone. The statistics then show where the emulator must be more
certain: further rounds simulate about the explanations that are left, with fresh seeds, and the question is
answered again. All runs stand in a ledger; a command that was stopped goes on where it was. An effect that a
scene cannot show is known from the scene itself, before a run is spent on it.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, product

import numpy as np

from taichi_erosion.campaign.execute import run_requests
from taichi_erosion.campaign.request import RunRequest, RunResult, request_of_scene
from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.evidence.data.problem import (
    Candidate,
    Floats,
    Mechanism,
    Numbers,
    Problem,
    Progress,
    QueryRows,
    SetUpFault,
)
from taichi_erosion.evidence.data.transforms import parameter_axis
from taichi_erosion.evidence.emulator import design
from taichi_erosion.evidence.emulator.design import PlanSize, Row, Setting, StudyScene, TrainingRun
from taichi_erosion.evidence.emulator.emulator import (
    Emulator,
    EmulatorInputs,
    ObservableEmulator,
    axis_scales,
    fit_emulators,
    replicate_scatter,
)
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.evidence.models.plugin import NameMapping
from taichi_erosion.evidence.models.simulator import Simulator, dotted_paths, row_at, study_value
from taichi_erosion.measures.result import Shortfall, shortfalls_of_most
from taichi_erosion.mechanisms.library import OF_WIND, load_mechanisms, physical_doses

LEVELS = 3  # of every condition that could be set
LEAST_BARE, LEAST_EFFECT = 4, 4  # runs that a small budget leaves, per number and of every effect
LARGEST = "full"  # budget whose plan contains those of the others
SPREAD = ("bare", "effect", "condition")  # numbers of a plan that say how many runs spread
RESERVED = 0.2  # of a small budget, for a closer look before something outside the list is blamed
SIZE_FLAGS = ("small_heap", "growing_angle")  # no fault where the laboratory's heap is as small
COMMON = 0.5  # share of the runs from which a fault is one of the set-up [1]


@dataclass(frozen=True)
class TrainingRuns:
    """All runs planned for a study so far."""

    study: Study
    simulator: Simulator
    scenes: tuple[StudyScene, ...]
    plan_size: PlanSize
    runs: tuple[TrainingRun, ...] = ()
    other_runs: int = 0  # planned for other questions of the study, and fresh runs that were made
    mechanisms: tuple[Mechanism, ...] = ()  # along whose doses there are runs


def initial_training_runs(study: Study, effects: Sequence[str], budget: str) -> TrainingRuns | None:
    """The first design of a study with some of its effects; None for a study that no scene answers.

    Every plan lies within the largest one that the study's cap allows, so that runs of all budgets together
    keep it, and every question of a study has the same bare runs. Raises BadInput where the cap is too small.
    """
    simulator = study.simulator
    if simulator is None:
        return None
    whole = TrainingRuns(study, simulator, study_scenes(study, simulator), design.PLAN_SIZES[LARGEST])
    as_stated = replace(whole, scenes=tuple(replace(scene, proposed_rows=()) for scene in whole.scenes))
    most, every = study.file.budget.runs or 10**9, effects_by_name(study.problem)
    for training in (whole, as_stated):
        size, planned = shrink_plan(most, training, every)
        if planned <= most:
            break
    else:
        words = f"a budget of {most} runs is too small; the study needs at least {planned}"
        raise BadInput(f"{study.path}: {words}: raise it, or list fewer candidates")
    usual = design.PLAN_SIZES[budget]
    numbers = {name: min(getattr(usual, name), getattr(size, name)) for name in SPREAD}
    rounds = usual.rounds if all(getattr(usual, name) == n for name, n in numbers.items()) else 0
    start = replace(training, plan_size=replace(usual, **numbers, rounds=rounds))
    runs = design_training_runs(start, effects)
    return replace(start, runs=tuple(runs), other_runs=planned - len(runs))


def shrink_plan(most: int, training: TrainingRuns, effects: Iterable[str]) -> tuple[PlanSize, int]:
    """A plan and its number of runs; where they pass `most`, a smaller one of its shape, without rounds."""
    size, planned = training.plan_size, len(design_training_runs(training, effects))
    if planned <= most:
        return size, planned
    share = (1.0 - RESERVED) * most / planned
    bare, effect = max(LEAST_BARE, int(size.bare * share)), max(LEAST_EFFECT, int(size.effect * share))
    size = replace(size, bare=bare, effect=effect, condition=int(size.condition * share), rounds=0)
    return size, len(design_training_runs(replace(training, plan_size=size), effects))


def study_scenes(study: Study, simulator: Simulator) -> tuple[StudyScene, ...]:
    """Scenes of a study with the conditions of its measurements, those of the vault included."""
    table, columns = study.problem.measurements, study.file.conditions
    axes = tuple(parameter_axis(parameter) for parameter in study.problem.parameters)
    grouped: dict[str, list[str]] = {}
    for name, measure in simulator.measures.items():
        grouped.setdefault(str(measure.scene), []).append(name)
    scenes = []
    for names in grouped.values():
        at = {columns[name]: column for name, column in table.conditions.items()}
        conditions_of_rows = (row_at(at, i) for i in range(table.size) if table.observable[i] in names)
        rows = tuple(design.distinct_condition_sets(conditions_of_rows, lambda _: True))
        proposed = laboratory_conditions(study, rows[0] if rows else {})
        scenes.append(StudyScene(simulator.measures[names[0]], tuple(names), rows, axes, simulator, proposed))
    return tuple(scenes)


def laboratory_conditions(study: Study, first: Row) -> tuple[Row, ...]:
    """Conditions that the laboratory could set: ends and middles of its ranges, else as measured first."""
    columns, ranges = study.file.conditions, study.file.laboratory.ranges
    levels = [[(name, x) for x in np.linspace(low, high, LEVELS)] for name, (low, high) in ranges.items()]
    sets = product(*levels) if levels else ()
    return tuple(first | {p: float(x) for n, x in each for p in dotted_paths(columns[n])} for each in sets)


def effects_by_name(problem: Problem) -> dict[str, Candidate]:
    return {candidate.name: candidate for candidate in (*problem.candidates, *problem.adopted)}


def design_training_runs(training: TrainingRuns, effects: Iterable[str]) -> list[TrainingRun]:
    """Runs of the bare model and of every effect, of adopted ones too: as measured, and where could be."""
    candidates, adopted = effects_by_name(training.study.problem), training.study.problem.adopted
    names = dict.fromkeys([*effects, *(candidate.name for candidate in adopted)])
    acting, tag = [None, *(candidates[name] for name in names)], training.study.fresh
    places = [(scene, tag) for scene in training.scenes]
    places += [(replace(s, rows=s.proposed_rows), f"{tag}ahead") for s, _ in places if s.proposed_rows]
    designs = (design.design_runs(s, each, training.plan_size, key) for s, key in places for each in acting)
    return [run for runs in designs for run in runs]


def add_dose_runs(training: TrainingRuns) -> TrainingRuns:
    """The runs with those along the dose of every mechanism that a scene of the study shows.

    A mechanism reads no condition: what moisture or angularity would do to its dose is left to inference.
    """
    allowance, tried = training.study.file.candidates.mechanisms, list[list[str]]()
    for scene in training.scenes:
        wind, library = training.simulator.load_scene_at(scene.measure.scene).wind, load_mechanisms()
        physics = (name for name in library if library[name].place != "instrument")
        able = [name for name in physics if wind is not None or name not in OF_WIND]
        tried.append([name for name in able if allowance is None or name in allowance])
    names = list(dict.fromkeys(name for names_of_scene in tried for name in names_of_scene))
    simulator = training.simulator.simulator_with_mechanisms(names)
    scenes = tuple(replace(scene, simulator=simulator) for scene in training.scenes)
    bare = [design.scene_with_numbers(scene, scene.mid_prior_numbers) for scene in scenes]
    mechanism_of = {name: Mechanism(name, *physical_doses(load_mechanisms()[name], bare)) for name in names}
    runs, size, tag = list(training.runs), training.plan_size, training.study.fresh
    for scene, able in zip(scenes, tried, strict=True):
        runs += [run for name in able for run in design.design_runs(scene, mechanism_of[name], size, tag)]
    mechanisms = tuple(mechanism_of.values())
    return replace(training, simulator=simulator, scenes=scenes, mechanisms=mechanisms, runs=tuple(runs))


def add_refinement_round(
    training: TrainingRuns, about: Sequence[Setting], key: str, budget: str | None = None
) -> TrainingRuns:
    """The runs with a further round about some explanations; rounds of other keys have other seeds.

    `budget`: that of the command which made the round. Points about effects that the study has no more stay
    without runs.
    """
    limits = {name: (0.0, each.maximum) for name, each in effects_by_name(training.study.problem).items()}
    limits |= {each.name: (each.low, each.high) for each in training.mechanisms}
    count = (training.plan_size if budget is None else design.PLAN_SIZES[budget]).round
    points = [(f"{key}|{k}", point) for k, point in enumerate(about) if point.effects.keys() <= limits.keys()]
    pairs = product(training.scenes, points)
    more = [design.refinement_runs(scene, limits, point, count, name) for scene, (name, point) in pairs]
    return replace(training, runs=(*training.runs, *chain(*more)))


def has_room_for_round(training: TrainingRuns, about: Sequence[Setting]) -> bool:
    return training.plan_size.round * len(about) * len(training.scenes) <= runs_left_by_cap(training)


def runs_left_by_cap(training: TrainingRuns) -> int:
    """Runs that the study's cap leaves beside those planned."""
    return (training.study.file.budget.runs or 10**9) - len(training.runs) - training.other_runs


def replace_scenes_by_emulator(training: TrainingRuns, progress: Progress) -> Study:
    """The study with an emulator in place of its scenes; simulates what is not in the ledger."""
    study, problem = training.study, training.study.problem
    runs, requests, refused = runs_to_make(training)
    results = execute_requests(training, requests, progress)
    emulators: dict[str, ObservableEmulator] = {}
    faults: list[SetUpFault] = []
    for scene in training.scenes:
        accepted = scene.measure.accepted_paths
        factors = design.mechanisms_scaling_numbers(scene)
        axes = tuple(axis for axis in scene.axes if axis.name in accepted)
        scales = axis_scales((*scene.rows, *scene.proposed_rows), accepted)
        names = tuple(each.name for each in training.mechanisms if each.name not in factors)
        inputs = EmulatorInputs(scene, axes, scales, tuple(effects_by_name(problem).values()), names, factors)
        trained = [each for each in zip(runs, results, strict=True) if each[0].scene == scene.measure.scene]
        faults += faults_of_scene_runs(study, scene, trained)
        try:
            emulators |= fit_emulators(inputs, trained, problem.observables)
        except SimulationStopped as error:
            sentences = [fault.sentence for fault in faults if fault.blocks]
            raise SimulationStopped("; ".join([*sentences, str(error)])) from None
    outcomes = [(run.effects, not result.failure) for run, result in zip(runs, results, strict=True)]
    candidates = tuple(
        replace(each, trials=tuple((acting[each.name], ok) for acting, ok in outcomes if each.name in acting))
        for each in problem.candidates
    )
    count = len({request.key for request in requests})
    sentences = f"{count} runs train the emulator that answers."
    notes = (*study.notes, sentences, *notes_on_invisible_effects(training), *refused)
    emulated, scatter = problem_with_emulator(problem, Emulator(emulators)), replicate_scatter(emulators)
    emulated = replace(emulated, candidates=candidates, mechanisms=training.mechanisms, replicates=scatter)
    return replace(study, problem=emulated, notes=notes, simulations=count, faults=(*study.faults, *faults))


def faults_of_scene_runs(
    study: Study, scene: StudyScene, trained: Sequence[tuple[TrainingRun, RunResult]]
) -> Iterator[SetUpFault]:
    """Faults that the runs of one scene show, those of the bare model where there are any."""
    results = [result for _, result in trained]
    failures = [result.failure for result in results if result.failure]
    if failures:
        name, count = scene.measure.scene.name, f"{len(failures)} of {len(results)}"
        counts = Counter(name for run, _ in trained for name in run.effects)
        lost = Counter(name for run, result in trained if result.failure for name in run.effects)
        which = "".join(f", {lost[each]} of {counts[each]} with {each}" for each in lost)
        words = f"{name}: {count} runs stopped and are left out{which}; the first: {failures[0]}"
        yield SetUpFault("failed_runs", name, words, len(failures) > COMMON * len(results))
    bare = [result for run, result in trained if not run.effects] or results
    whole = [result for result in bare if not result.failure]
    for name in scene.observables:
        yield from faults_of_missing_values(scene, name, whole, study.file.observables[name].same_size)


def faults_of_missing_values(
    scene: StudyScene, name: str, ended: Sequence[RunResult], same_size: bool
) -> Iterator[SetUpFault]:
    """What most runs lack for one observable, in the words of the run in the middle; why they have no value.

    A measure itself says what it lacks (`measures/shortfalls.py`); here its runs are counted.
    """
    measure, blocked = scene.simulator.measures[name], False
    records = [result.record.get("measures", {}).get(measure.measure, {}) for result in ended]
    repeats = [[Shortfall(**each) for each in record.get("shortfalls", ())] for record in records]
    for lack in shortfalls_of_most(repeats):
        blocked = blocked or lack.blocks
        if lack.flag not in SIZE_FLAGS or not same_size:
            kind = "too_small" if lack.blocks else "not_converged"
            yield SetUpFault(kind, name, f"{name}: {lack.sentence}", lack.blocks)
    missing = sum(not np.isfinite(study_value(result, measure)) for result in ended)
    if missing > COMMON * len(records) and not blocked:
        notes = [note for each in records if each.get("value") is None for note in each.get("notes", ())]
        why = f"; the first: {notes[0]}" if notes else ""
        words = f"{name}: {missing} of {len(records)} runs have no value{why}"
        yield SetUpFault("no_value", name, words, True)


def execute_requests(
    training: TrainingRuns, requests: Sequence[RunRequest], progress: Progress
) -> list[RunResult]:
    """Results of some runs of a study; simulates what is not in its ledger."""
    campaign = training.study.file.campaign
    return run_requests(
        requests,
        training.simulator.shared_ledger(),
        workers=campaign.workers,
        scheduler=campaign.scheduler,
        progress=lambda share, words: progress(f"simulating: {words}", share),
    )


def runs_to_make(training: TrainingRuns) -> tuple[list[TrainingRun], list[RunRequest], list[str]]:
    """Runs that scenes accept, their requests, and why effects were refused."""
    measures = {scene.measure.scene: scene.measure for scene in training.scenes}
    runs, requests, refused = [], [], {}
    for run in training.runs:
        words = training.simulator.overrides(measures[run.scene], run.at, run.parameters, run.effects)
        try:
            scene = training.simulator.load_scene_at(run.scene, words)
            requests.append(request_of_scene(scene, run.seed, device=training.simulator.device))
        except BadInput as error:
            if not run.effects:
                raise
            refused["+".join(run.effects)] = str(error)
            continue
        runs.append(run)
    return runs, requests, [f"{name} cannot act here: {reason}" for name, reason in refused.items()]


def problem_with_emulator(problem: Problem, emulator: Emulator) -> Problem:
    """The problem with an emulator for a model, and the covariance of its errors."""
    model = problem.model
    assert isinstance(model, NameMapping)
    mapped = replace(model, model=emulator)

    def emulator_covariance(queries: Sequence[QueryRows], parameters: Numbers, effects: Numbers) -> Floats:
        renamed = [(name, mapped.model_conditions(at), doses) for name, at, doses in queries]
        return emulator.error_covariance(renamed, parameters, effects)

    # an emulator costs nothing: its calibration need not be frugal
    return replace(problem, model=mapped, uncertainty=emulator_covariance, dosed_by_row=True, runs=None)


def notes_on_invisible_effects(training: TrainingRuns) -> list[str]:
    """Candidates that no scene of the study can show."""
    candidates = training.study.problem.candidates
    reasons = {c.name: [design.why_effect_cannot_act(s, c) for s in training.scenes] for c in candidates}
    return [f"{name} was not simulated: {why[0]}." for name, why in reasons.items() if None not in why]
