"""Effects that a scene cannot show: told from the scene itself, before a run is spent on them.

A study of scenes made ready for questions: runs planned, simulated or found, and turned into surfaces.

The first plan follows from the study alone. What the statistics then make of it says where the surfaces must
be surer: further rounds simulate about the explanations that are left, with fresh seeds, and the question is
put again. All runs stand in a ledger; a command that was stopped goes on where it was.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import isfinite

import numpy as np

from taichi_erosion.campaign.execute import execute
from taichi_erosion.campaign.request import RunRequest, RunResult, request_of
from taichi_erosion.core.effect import Effect, read_params
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import (
    Budget,
    Candidate,
    Floats,
    Observable,
    Problem,
    expected_strength,
)
from taichi_erosion.evidence.data.transforms import Axis, parameter_axis
from taichi_erosion.evidence.emulator.design import (
    PLAN_SIZES,
    PlanSize,
    RefinementPoint,
    Row,
    SceneRows,
    TrainingRun,
    bare_plan,
    cells,
    effect_plan,
    round_plan,
)
from taichi_erosion.evidence.emulator.emulator import (
    Emulator,
    EmulatorInputs,
    ObservableEmulator,
    rulers_of,
    train,
)
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.evidence.models.plugin import NameMapping
from taichi_erosion.evidence.models.simulator import Simulator, paths_in, read_scene_once
from taichi_erosion.simulation.scene_setup import conditions_of, effective_scene


def why_idle(simulator: Simulator, bench: SceneRows, candidate: Candidate) -> str | None:
    """Why an effect changes nothing that a scene answers, None where it may."""
    effect, scene = simulator.library[candidate.name], bench.answer.scene
    rows, strength = cells(bench, simulator, (candidate.name,)), expected_strength(candidate)
    if not rows:
        return "none of the conditions lets it act"
    try:
        still = all(changes_nothing(simulator, bench, effect, strength, row) for row in rows)
    except BadInput as error:
        return str(error)
    return f"{scene.name} does not depend on it" if still else None


def changes_nothing(
    simulator: Simulator, bench: SceneRows, effect: Effect, strength: float, row: Row
) -> bool:
    """Whether an effect leaves the scene and all readings as they are."""
    if effect.place not in ("scene", "instrument"):
        return False
    words = simulator.overrides(bench.answer, row, {}, {effect.name: strength})
    scene = read_scene_once(bench.answer.scene, words)
    if effect.place == "scene":
        return effective_scene(scene, simulator.library) is scene
    params, _ = read_params(effect, scene.effects[effect.name])
    measures = [simulator.answers[name].measure for name in bench.observables]
    readings = [effect.act(params, strength, conditions_of(scene), measure, 1.0) for measure in measures]
    return all(reading == 1.0 for reading in readings)


Tell = Callable[[str, float], None]
LEVELS = 3  # of every condition that could be set
LEAST_BARE, LEAST_EFFECT = 4, 4  # runs that a small budget leaves, per number and of every effect
KEPT = 0.2  # of a small budget, for a closer look before something outside the list is blamed
SURE = 3.0  # sd of a left-out value beyond which it counts as missed


@dataclass(frozen=True)
class TrainingRuns:
    """Everything simulated for a study so far."""

    study: Study
    simulator: Simulator
    benches: tuple[SceneRows, ...]
    amount: PlanSize
    settings: tuple[TrainingRun, ...]


def initial_training_runs(
    study: Study, effects: Sequence[str], budget: str, ahead: bool = False
) -> TrainingRuns | None:
    """The first plan of a study with some of its effects; None for a study that no scene answers.

    `ahead` adds conditions that the laboratory could measure.
    """
    model = study.problem.model
    simulator = model.model if isinstance(model, NameMapping) else model
    if not isinstance(simulator, Simulator):
        return None
    benches = benches_of(study, simulator)
    if ahead:
        benches = tuple(replace(bench, ahead=rows_ahead(study, bench)) for bench in benches)
    start = TrainingRuns(study, simulator, benches, PLAN_SIZES[budget], ())
    whole, most = len(first_plan(start, list(known_effects(study.problem)))), affordable(study, benches)
    if whole > most:  # every question of a study has the same bare runs, whatever effects it asks for
        start = replace(start, amount=reduced(start.amount, (1.0 - KEPT) * most / whole))
    return replace(start, settings=tuple(first_plan(start, effects)))


def benches_of(study: Study, simulator: Simulator) -> tuple[SceneRows, ...]:
    """Scenes of a study with the conditions of its measurements, those of the vault included."""
    table, said = study.problem.measurements, study.file.conditions
    grouped: dict[str, list[str]] = {}
    for name, answer in simulator.answers.items():
        grouped.setdefault(str(answer.scene), []).append(name)
    found = []
    for names in grouped.values():
        rows: dict[tuple[tuple[str, float], ...], Row] = {}
        for i in range(table.size):
            if table.observable[i] in names:
                row = {
                    path: float(column[i])
                    for name, column in table.conditions.items()
                    for path in paths_in(said[name])
                    if isfinite(column[i])
                }
                rows.setdefault(tuple(sorted(row.items())), row)
        found.append(SceneRows(simulator.answers[names[0]], tuple(names), tuple(rows.values())))
    return tuple(found)


def rows_ahead(study: Study, bench: SceneRows) -> tuple[Row, ...]:
    """Conditions that the laboratory could set: ends and middles of its ranges, else as measured first."""
    said, ranges = study.file.conditions, study.file.laboratory.ranges
    levels = [
        [(name, value) for value in np.linspace(low, high, LEVELS)] for name, (low, high) in ranges.items()
    ]
    first = bench.rows[0] if bench.rows else {}
    return tuple(
        first | {path: float(value) for name, value in chosen for path in paths_in(said[name])}
        for chosen in product(*levels)
        if chosen
    )


def affordable(study: Study, benches: Sequence[SceneRows]) -> int:
    """Single simulations within the study's budget; one run there is all conditions at one setting."""
    runs = study.file.budget.runs
    return 10**9 if runs is None else runs * sum(len(bench.rows) for bench in benches)


def reduced(amount: PlanSize, share: float) -> PlanSize:
    """A smaller plan of the same shape, for a budget that leaves no rounds to every question."""
    return replace(
        amount,
        bare=max(LEAST_BARE, int(amount.bare * share)),
        effect=max(LEAST_EFFECT, int(amount.effect * share)),
        condition=int(amount.condition * share),
        rounds=0,
    )


def known_effects(problem: Problem) -> dict[str, Candidate]:
    """Candidates and adopted effects by name."""
    return {candidate.name: candidate for candidate in (*problem.candidates, *problem.adopted)}


def axes_of(problem: Problem) -> tuple[Axis, ...]:
    """Calibrated numbers that are no strengths."""
    return tuple(parameter_axis(parameter) for parameter in problem.parameters)


def first_plan(training_runs: TrainingRuns, effects: Sequence[str]) -> list[TrainingRun]:
    """Runs of the bare model and of every effect, of adopted ones too."""
    problem, simulator = training_runs.study.problem, training_runs.simulator
    axes, known = axes_of(problem), known_effects(problem)
    names = dict.fromkeys([*effects, *(candidate.name for candidate in problem.adopted)])
    settings: list[TrainingRun] = []
    for bench in training_runs.benches:
        wider = [(replace(bench, rows=bench.ahead, ahead=()), "ahead")] if bench.ahead else []
        for there, tag in [(bench, ""), *wider]:
            settings += bare_plan(there, simulator, axes, training_runs.amount, tag)
            for name in names:
                if why_idle(simulator, there, known[name]) is None:
                    settings += effect_plan(there, simulator, axes, known[name], training_runs.amount, tag)
    return settings


def refined_training_runs(
    training_runs: TrainingRuns, about: Sequence[RefinementPoint], key: str
) -> TrainingRuns:
    """A further round about some explanations; rounds of other keys have other seeds."""
    problem = training_runs.study.problem
    axes, known = axes_of(problem), known_effects(problem)
    more: list[TrainingRun] = []
    for bench in training_runs.benches:
        for number, explanation in enumerate(about):
            share = (known, explanation, training_runs.amount.round, f"{key}|{number}")
            more += round_plan(bench, training_runs.simulator, axes, *share)
    return replace(training_runs, settings=(*training_runs.settings, *more))


def within_budget(training_runs: TrainingRuns, about: Sequence[RefinementPoint]) -> bool:
    """Whether the study's budget has room for a further round."""
    more = training_runs.amount.round * len(about) * len(training_runs.benches)
    return len(training_runs.settings) + more <= affordable(training_runs.study, training_runs.benches)


def requested(
    simulator: Simulator, benches: Sequence[SceneRows], settings: Sequence[TrainingRun]
) -> tuple[list[TrainingRun], list[RunRequest], dict[str, str]]:
    """Runs that scenes accept, their requests, and why effects were refused."""
    answers = {bench.answer.scene: bench.answer for bench in benches}
    kept, requests, refused = [], [], {}
    for setting in settings:
        answer = answers[setting.scene]
        words = simulator.overrides(answer, setting.at, setting.parameters, setting.effects)
        try:
            requests.append(request_of(read_scene_once(setting.scene, words), setting.seed))
        except BadInput as error:
            if not setting.effects:
                raise
            refused["+".join(setting.effects)] = str(error)
            continue
        kept.append(setting)
    return kept, requests, refused


def emulated_study(training_runs: TrainingRuns, tell: Tell) -> Study:
    """The study with surfaces in place of its scenes; simulates what is not in the ledger."""
    study, simulator = training_runs.study, training_runs.simulator
    settings, requests, refused = requested(simulator, training_runs.benches, training_runs.settings)
    results = execute(
        requests, simulator.opened(), progress=lambda share, words: tell(f"simulating: {words}", share)
    )
    answered: dict[str, ObservableEmulator] = {}
    for bench in training_runs.benches:
        own = [k for k, setting in enumerate(settings) if setting.scene == bench.answer.scene]
        answered |= train(
            bench,
            ground_of(training_runs, bench),
            [settings[k] for k in own],
            [results[k] for k in own],
            study.problem.observables,
            simulator.answers,
        )
    surfaces = Emulator(answered)
    told = (*run_notes(results, requests), *idle_notes(training_runs), *refusal_notes(refused))
    notes = (*study.notes, *told, *surface_notes(answered))
    count = len({request.key for request in requests})
    return replace(study, problem=surfaced(training_runs, surfaces), notes=notes, simulations=count)


def ground_of(training_runs: TrainingRuns, bench: SceneRows) -> EmulatorInputs:
    """Coordinates of one scene's surfaces."""
    problem, answer = training_runs.study.problem, bench.answer
    return EmulatorInputs(
        answer=answer,
        axes=tuple(axis for axis in axes_of(problem) if axis.name in answer.accepted_paths),
        rulers=rulers_of((*bench.rows, *bench.ahead), answer.accepted_paths),
        candidates=tuple(known_effects(problem).values()),
        simulator=training_runs.simulator,
    )


def surfaced(training_runs: TrainingRuns, surfaces: Emulator) -> Problem:
    """The problem with surfaces for a model, and what they do not know."""
    problem = training_runs.study.problem
    model = problem.model
    assert isinstance(model, NameMapping)
    spoken = replace(model, model=surfaces)

    def uncertainty(
        observable: Observable,
        conditions: dict[str, Floats],
        parameters: dict[str, float],
        effects: dict[str, float],
    ) -> Floats:
        return surfaces.uncertainty(observable, spoken.known(conditions), parameters, effects)

    # a surface costs nothing: its calibration need not be frugal
    return replace(problem, model=spoken, uncertainty=uncertainty, budget=Budget("full", 10**6))


def run_notes(results: Sequence[RunResult], requests: Sequence[RunRequest]) -> list[str]:
    """How many runs there were, and what became of those that failed."""
    count = len({request.key for request in requests})
    failures = [result.failure for result in results if result.failure]
    notes = [f"{count} simulations stand behind the surfaces that answer."]
    if failures:
        notes.append(f"{len(failures)} of them stopped and are left out; the first: {failures[0]}")
    return notes


def idle_notes(training_runs: TrainingRuns) -> list[str]:
    """Candidates that no scene of the study can show."""
    notes = []
    for candidate in training_runs.study.problem.candidates:
        reasons = [why_idle(training_runs.simulator, bench, candidate) for bench in training_runs.benches]
        if all(reason is not None for reason in reasons):
            notes.append(f"{candidate.name} was not simulated: {reasons[0]}.")
    return notes


def refusal_notes(refused: Mapping[str, str]) -> list[str]:
    """Effects that a scene cannot hold."""
    return [f"{name} cannot act here: {reason}" for name, reason in refused.items()]


def surface_notes(answered: Mapping[str, ObservableEmulator]) -> list[str]:
    """Whether runs that a surface has not seen lie where it says."""
    notes = []
    for name, found in answered.items():
        off = found.surface.left_out()
        spread, missed = float(np.sqrt(np.mean(off**2))), int(np.sum(np.abs(off) > SURE))
        notes.append(
            f"{name}: {off.size} runs, each predicted from the others within {spread:.2f} of its standard "
            f"error; {missed} beyond {SURE:g}."
        )
    return notes
