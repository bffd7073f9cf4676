"""Training runs of a study that scenes answer: planned, executed or found in the ledger, and emulated.

The first design follows from the study alone. The statistics then show where the emulator must be more
certain: further rounds simulate about the explanations that are left, with fresh seeds, and the question is
answered again. All runs stand in a ledger; a command that was stopped goes on where it was. An effect that a
scene cannot show is known from the scene itself, before a run is spent on it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import isfinite

import numpy as np

from taichi_erosion.campaign.execute import execute
from taichi_erosion.campaign.request import RunRequest, request_of
from taichi_erosion.core.effect import read_params
from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.evidence.data.findings import SetUpFault
from taichi_erosion.evidence.data.problem import (
    Budget,
    Candidate,
    Conditions,
    Floats,
    Numbers,
    Observable,
    Problem,
    Progress,
    expected_strength,
)
from taichi_erosion.evidence.data.transforms import parameter_axis
from taichi_erosion.evidence.emulator import design
from taichi_erosion.evidence.emulator.design import PlanSize, RefinementPoint, Row, StudyScene, TrainingRun
from taichi_erosion.evidence.emulator.emulator import (
    Emulator,
    EmulatorInputs,
    ObservableEmulator,
    condition_scales,
    fit_emulators,
)
from taichi_erosion.evidence.emulator.run_faults import run_faults
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.evidence.models.plugin import NameMapping
from taichi_erosion.evidence.models.simulator import Simulator, dotted_paths
from taichi_erosion.simulation.scene_setup import circumstances_of, effective_scene

LEVELS = 3  # of every condition that could be set
LEAST_BARE, LEAST_EFFECT = 4, 4  # runs that a small budget leaves, per number and of every effect
RESERVED = 0.2  # of a small budget, for a closer look before something outside the list is blamed
SURE = 3.0  # sd of a left-out value beyond which it counts as missed


@dataclass(frozen=True)
class TrainingRuns:
    """All runs planned for a study so far."""

    study: Study
    simulator: Simulator
    scenes: tuple[StudyScene, ...]
    plan_size: PlanSize
    runs: tuple[TrainingRun, ...] = ()


def initial_training_runs(
    study: Study, effects: Sequence[str], budget: str, proposed: bool = False
) -> TrainingRuns | None:
    """The first design of a study with some of its effects; None for a study that no scene answers.

    `proposed` adds conditions that the laboratory could measure.
    """
    model = study.problem.model
    simulator = model.model if isinstance(model, NameMapping) else model
    if not isinstance(simulator, Simulator):
        return None
    scenes = study_scenes(study, simulator)
    if proposed:
        scenes = tuple(replace(scene, proposed=proposed_rows(study, scene)) for scene in scenes)
    start = TrainingRuns(study, simulator, scenes, design.PLAN_SIZES[budget])
    whole, most = len(first_runs(start, list(known_effects(study.problem)))), run_budget(start)
    if whole > most:  # every question of a study has the same bare runs, whatever effects it asks for
        start = replace(start, plan_size=scaled_down(start.plan_size, (1.0 - RESERVED) * most / whole))
    return replace(start, runs=tuple(first_runs(start, effects)))


def study_scenes(study: Study, simulator: Simulator) -> tuple[StudyScene, ...]:
    """Scenes of a study with the conditions of its measurements, those of the vault included."""
    table, columns = study.problem.measurements, study.file.conditions
    axes = tuple(parameter_axis(parameter) for parameter in study.problem.parameters)
    grouped: dict[str, list[str]] = {}
    for name, measure in simulator.measures.items():
        grouped.setdefault(str(measure.scene), []).append(name)
    found = []
    for names in grouped.values():
        rows: dict[tuple[tuple[str, float], ...], Row] = {}
        for i in (i for i in range(table.size) if table.observable[i] in names):
            row = {
                path: float(column[i])
                for name, column in table.conditions.items()
                for path in dotted_paths(columns[name])
                if isfinite(column[i])
            }
            rows.setdefault(tuple(sorted(row.items())), row)
        measure = simulator.measures[names[0]]
        found.append(StudyScene(measure, tuple(names), tuple(rows.values()), axes, simulator))
    return tuple(found)


def proposed_rows(study: Study, scene: StudyScene) -> tuple[Row, ...]:
    """Conditions that the laboratory could set: ends and middles of its ranges, else as measured first."""
    columns, ranges = study.file.conditions, study.file.laboratory.ranges
    levels = [
        [(name, value) for value in np.linspace(low, high, LEVELS)] for name, (low, high) in ranges.items()
    ]
    first = scene.rows[0] if scene.rows else {}
    return tuple(
        first | {path: float(value) for name, value in chosen for path in dotted_paths(columns[name])}
        for chosen in product(*levels)
        if chosen
    )


def run_budget(training: TrainingRuns) -> int:
    """Single simulations within the study's budget; one run there is all conditions at one setting."""
    runs = training.study.file.budget.runs
    return 10**9 if runs is None else runs * sum(len(scene.rows) for scene in training.scenes)


def scaled_down(size: PlanSize, share: float) -> PlanSize:
    """A smaller design of the same shape, for a budget that leaves no rounds to every question."""
    return replace(
        size,
        bare=max(LEAST_BARE, int(size.bare * share)),
        effect=max(LEAST_EFFECT, int(size.effect * share)),
        condition=int(size.condition * share),
        rounds=0,
    )


def known_effects(problem: Problem) -> dict[str, Candidate]:
    """Candidates and adopted effects by name."""
    return {candidate.name: candidate for candidate in (*problem.candidates, *problem.adopted)}


def first_runs(training: TrainingRuns, effects: Sequence[str]) -> list[TrainingRun]:
    """Runs of the bare model and of every effect, of adopted ones too."""
    problem, size = training.study.problem, training.plan_size
    known = known_effects(problem)
    names = dict.fromkeys([*effects, *(candidate.name for candidate in problem.adopted)])
    runs: list[TrainingRun] = []
    for scene in training.scenes:
        fresh = training.study.fresh
        wider = (
            [(replace(scene, rows=scene.proposed, proposed=()), f"{fresh}ahead")] if scene.proposed else []
        )
        for there, tag in [(scene, fresh), *wider]:
            runs += design.base_runs(there, size, tag)
            for name in names:
                if inactive_reason(there, known[name]) is None:
                    runs += design.effect_runs(there, known[name], size, tag)
    return runs


def inactive_reason(scene: StudyScene, candidate: Candidate) -> str | None:
    """Why an effect changes nothing that a scene measures, None where it may."""
    rows = design.distinct_conditions(scene, (candidate.name,))
    if not rows:
        return "none of the conditions lets it act"
    try:
        inactive = all(leaves_readings(scene, candidate, row) for row in rows)
    except BadInput as error:
        return str(error)
    return f"{scene.measure.scene.name} does not depend on it" if inactive else None


def leaves_readings(scene: StudyScene, candidate: Candidate, row: Row) -> bool:
    """Whether an effect leaves the scene and all readings as they are."""
    simulator, strength = scene.simulator, expected_strength(candidate)
    effect = simulator.library[candidate.name]
    if effect.place not in ("scene", "instrument"):
        return False
    changed = simulator.scene(
        scene.measure.scene, simulator.overrides(scene.measure, row, {}, {effect.name: strength})
    )
    if effect.place == "scene":
        return effective_scene(changed, simulator.library) is changed
    params, _ = read_params(effect, changed.effects[effect.name])
    measures = [simulator.measures[name].measure for name in scene.observables]
    readings = [effect.act(params, strength, circumstances_of(changed), measure, 1.0) for measure in measures]
    return all(reading == 1.0 for reading in readings)


def refined_training_runs(training: TrainingRuns, about: Sequence[RefinementPoint], key: str) -> TrainingRuns:
    """The runs with a further round about some explanations; rounds of other keys have other seeds."""
    known, count = known_effects(training.study.problem), training.plan_size.round
    more: list[TrainingRun] = []
    for scene in training.scenes:
        for number, point in enumerate(about):
            more += design.refinement_runs(scene, known, point, count, f"{key}|{number}")
    return replace(training, runs=(*training.runs, *more))


def within_budget(training: TrainingRuns, about: Sequence[RefinementPoint]) -> bool:
    """Whether the study's budget has room for a further round."""
    more = training.plan_size.round * len(about) * len(training.scenes)
    return len(training.runs) + more <= run_budget(training)


def emulated_study(training: TrainingRuns, progress: Progress) -> Study:
    """The study with an emulator in place of its scenes; simulates what is not in the ledger."""
    study, simulator = training.study, training.simulator
    runs, requests, refused = requested(training)
    results = execute(
        requests,
        simulator.opened(),
        workers=study.file.campaign.workers,
        scheduler=study.file.campaign.scheduler,
        progress=lambda share, words: progress(f"simulating: {words}", share),
    )
    emulators: dict[str, ObservableEmulator] = {}
    faults: list[SetUpFault] = []
    for scene in training.scenes:
        own = [k for k, run in enumerate(runs) if run.scene == scene.measure.scene]
        inputs = emulator_inputs(study.problem, scene)
        trained = [(runs[k], results[k]) for k in own]
        faults += run_faults(study, scene, trained)
        try:
            emulators |= fit_emulators(inputs, trained, study.problem.observables)
        except SimulationStopped as error:
            told = [fault.sentence for fault in faults if fault.blocks]
            raise SimulationStopped("; ".join([*told, str(error)])) from None
    notes = (run_note(requests), *inactive_notes(training), *refused, *emulator_notes(emulators))
    return replace(
        study,
        problem=emulated_problem(study.problem, Emulator(emulators)),
        notes=(*study.notes, *notes),
        simulations=len({request.key for request in requests}),
        faults=tuple(faults),
    )


def requested(training: TrainingRuns) -> tuple[list[TrainingRun], list[RunRequest], list[str]]:
    """Runs that scenes accept, their requests, and why effects were refused."""
    measures = {scene.measure.scene: scene.measure for scene in training.scenes}
    kept, requests, refused = [], [], {}
    for run in training.runs:
        words = training.simulator.overrides(measures[run.scene], run.at, run.parameters, run.effects)
        try:
            requests.append(request_of(training.simulator.scene(run.scene, words), run.seed))
        except BadInput as error:
            if not run.effects:
                raise
            refused["+".join(run.effects)] = str(error)
            continue
        kept.append(run)
    return kept, requests, [f"{name} cannot act here: {reason}" for name, reason in refused.items()]


def emulator_inputs(problem: Problem, scene: StudyScene) -> EmulatorInputs:
    """Inputs of the emulators of one scene."""
    accepted = scene.measure.accepted_paths
    return EmulatorInputs(
        scene=scene,
        axes=tuple(axis for axis in scene.axes if axis.name in accepted),
        scales=condition_scales((*scene.rows, *scene.proposed), accepted),
        candidates=tuple(known_effects(problem).values()),
    )


def emulated_problem(problem: Problem, emulator: Emulator) -> Problem:
    """The problem with an emulator for a model, and the covariance of its errors."""
    model = problem.model
    assert isinstance(model, NameMapping)
    mapped = replace(model, model=emulator)

    def uncertainty(
        observable: Observable, conditions: Conditions, parameters: Numbers, effects: Numbers
    ) -> Floats:
        return emulator.uncertainty(observable, mapped.known(conditions), parameters, effects)

    # an emulator costs nothing: its calibration need not be frugal
    return replace(problem, model=mapped, uncertainty=uncertainty, budget=Budget("full", 10**6))


def run_note(requests: Sequence[RunRequest]) -> str:
    """How many runs there were."""
    return f"{len({request.key for request in requests})} runs train the emulator that answers."


def inactive_notes(training: TrainingRuns) -> list[str]:
    """Candidates that no scene of the study can show."""
    notes = []
    for candidate in training.study.problem.candidates:
        reasons = [inactive_reason(scene, candidate) for scene in training.scenes]
        if all(reason is not None for reason in reasons):
            notes.append(f"{candidate.name} was not simulated: {reasons[0]}.")
    return notes


def emulator_notes(emulators: Mapping[str, ObservableEmulator]) -> list[str]:
    """Errors of the emulators by leave-one-out cross-validation."""
    notes = []
    for name, found in emulators.items():
        off = found.process.leave_one_out()
        spread, missed = float(np.sqrt(np.mean(off**2))), int(np.sum(np.abs(off) > SURE))
        notes.append(
            f"{name}: {off.size} runs, each predicted from the others within {spread:.2f} of its standard "
            f"error; {missed} beyond {SURE:g}."
        )
    return notes
