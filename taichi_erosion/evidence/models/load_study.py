"""From a study file to a problem that the statistics can examine, and what is to be said about the way."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from taichi_erosion.campaign.study_file import (
    ALL,
    AdoptedEntry,
    CandidateEntry,
    ObservableEntry,
    StudyFile,
    read_evidence_study,
)
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.held_out_rows import content_digest, openings, split
from taichi_erosion.evidence.data.measured import read_table, study_measurements
from taichi_erosion.evidence.data.problem import (
    Budget,
    Candidate,
    Measurements,
    Model,
    Observable,
    Parameter,
    Problem,
    Vault,
)
from taichi_erosion.evidence.models.plugin import ModelErrorCovariance, NameMapping, Plugin, load_plugin
from taichi_erosion.evidence.models.run_store import FILE, CachedModel, RunStore

Report = Callable[[float, str], None]  # (share done [1], words)

LONGEST_CHAIN = 20  # studies that follow one another


@dataclass(frozen=True)
class Study:
    """A study ready to be examined."""

    path: Path
    file: StudyFile
    problem: Problem
    results: Path  # folder of everything that is found
    digest: str  # of the measurements
    model: str  # what answers, and its version
    store: RunStore
    notes: tuple[str, ...]  # what the report has to say about the table and the vault
    simulations: int | None = None  # behind the surfaces that answer; None where a function answers


@dataclass(frozen=True)
class Answering:
    """What answers a study, and what may be missing in it."""

    model: Model
    identity: str  # what answers, and its version
    candidates: Sequence[Candidate]
    adopted: tuple[Candidate, ...]
    store: RunStore
    numbers: tuple[Parameter, ...] = ()  # of effects themselves, to be calibrated with them
    plugin: Plugin | None = None  # the function, where one answers


def load_study(
    path: Path, budget: Literal["quick", "full"] | None = None, report: Report | None = None
) -> Study:
    """Study of a file; reads everything that it names and simulates nothing. Raises BadInput.

    `report` is told how far the simulations of a request are; a model function has no such steps.
    """
    file = read_evidence_study(path)
    table = read_table(path.parent / file.study.measurements, file.study.measurements)
    measurements, notes = study_measurements(table, file, str(path))
    hidden, said = split(measurements, file.vault.fraction, file.vault.ranges)
    results = results_folder(path, file)
    digest = content_digest(measurements)
    if file.study.model is not None:
        answering = function_study(path, file, results)
    else:
        answering = scene_answers(path, file, results, measurements, report)
    spoken = NameMapping(answering.model, dict(file.conditions), measures_of(file))
    problem = Problem(
        measurements=measurements,
        observables={name: observable_of(name, entry) for name, entry in file.observables.items()},
        parameters=(
            *(
                Parameter(name, entry.start, entry.low, entry.high, entry.prior_sd_log)
                for name, entry in file.parameters.items()
            ),
            *answering.numbers,
        ),
        candidates=tuple(answering.candidates),
        model=spoken,
        budget=budget_of(file, budget),
        vault=Vault(hidden, openings(results, digest)),
        adopted=answering.adopted,
        uncertainty=own_errors(answering.plugin, spoken, file.study.seed),
    )
    return Study(path, file, problem, results, digest, answering.identity, answering.store, (*notes, said))


def function_study(path: Path, file: StudyFile, results: Path) -> Answering:
    """A study that a function answers; its runs are kept in a store."""
    assert file.study.model is not None
    plugin = load_plugin(file.study.model, path.parent, str(path))
    identity = f"{plugin.name} {plugin.version}"
    store = RunStore(results / FILE)
    adopted = tuple(candidate_of(name, entry) for name, entry in file.adopted.items())
    model, candidates = CachedModel(plugin, identity, store), candidates_of(file, str(path))
    return Answering(model, identity, candidates, adopted, store, plugin=plugin)


def own_errors(plugin: Plugin | None, spoken: NameMapping, seed: int) -> ModelErrorCovariance | None:
    """What a model function says of its own errors; None where it says nothing."""
    return None if plugin is None or plugin.covariance is None else ModelErrorCovariance(plugin, spoken, seed)


def scene_answers(
    path: Path, file: StudyFile, results: Path, measurements: Measurements, report: Report | None
) -> Answering:
    """A study that scenes answer; their runs are kept in the ledger of a campaign."""
    from taichi_erosion.evidence.models import scene_study

    runs = results if file.study.runs is None else path.parent / file.study.runs
    simulator = scene_study.simulator_of(path, file, measurements, runs)
    simulator.report = report
    candidates = scene_study.library_candidates(file, simulator, str(path))
    adopted = tuple(
        scene_study.library_candidate(simulator, name, entry, file.conditions)
        for name, entry in file.adopted.items()
    )
    numbers = scene_study.own_numbers(file, simulator, measurements, (*candidates, *adopted))
    simulator = scene_study.understanding(simulator, numbers)
    identity = scene_study.identity_of(simulator)
    return Answering(simulator, identity, candidates, adopted, RunStore(results / FILE), numbers)


def measures_of(file: StudyFile) -> dict[str, str]:
    """What a model function calls every observable; a scene is asked for the observable itself."""
    if file.study.model is None:
        return {name: name for name in file.observables}
    return {name: entry.measure or name for name, entry in file.observables.items()}


def budget_of(file: StudyFile, name: Literal["quick", "full"] | None) -> Budget:
    """What may be spent; what neither the file nor the user says is the default of Budget."""
    words = {"name": name, "runs": file.budget.runs}
    return replace(Budget(), **{word: said for word, said in words.items() if said is not None})


def observable_of(name: str, entry: ObservableEntry) -> Observable:
    """How an observable is compared."""
    return Observable(
        name,
        entry.transform,
        entry.floor or 0.0,
        entry.sd_shared,
        entry.sd_numerical,
        entry.sd_shared_relative,
    )


def candidates_of(file: StudyFile, name: str) -> Sequence[Candidate]:
    """Effects to try: those of the list, or all that have a table; an adopted effect is none any more."""
    said = file.candidates
    listed = () if said.effects == (ALL,) else said.effects
    for effect in said.tables:
        if listed and effect not in listed:
            raise BadInput(f"{name}: candidates.{effect} is not in candidates.effects = {list(listed)}")
    return [
        candidate_of(effect, said.tables.get(effect, CandidateEntry()))
        for effect in dict.fromkeys(listed or said.tables)
        if effect not in file.adopted
    ]


def candidate_of(name: str, entry: CandidateEntry | AdoptedEntry) -> Candidate:
    """An effect with what the study says about it; the rest is the default of Candidate."""
    words = {"prior_scale": entry.prior_scale, "maximum": entry.max}
    return replace(Candidate(name), **{word: said for word, said in words.items() if said is not None})


def results_folder(path: Path, file: StudyFile) -> Path:
    """`<stem>-results` beside the study, or beside the first of the studies that it follows."""
    for _ in range(LONGEST_CHAIN):
        if file.study.follows is None:
            return path.with_name(f"{path.stem}-results")
        path = path.parent / file.study.follows
        file = read_evidence_study(path)
    raise BadInput(f"{path}: study.follows = '{file.study.follows}' leads in a circle")
