"""Loading of a study: from a study file and all that it names to a problem for the statistics."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from taichi_erosion.campaign.study_file import ALL, CandidateEntry, StudyFile, read_evidence_study
from taichi_erosion.core.effect import Effect
from taichi_erosion.core.effect_file import EffectFile, read_effect_files
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import ArchChoice, Decomposition
from taichi_erosion.evidence.data.held_out_rows import SPARE, draw_vault, table_digest, vault_openings
from taichi_erosion.evidence.data.measured import read_measured_table, study_measurements
from taichi_erosion.evidence.data.problem import (
    Candidate,
    Measurements,
    Mechanism,
    Observable,
    Parameter,
    Problem,
    SetUpFault,
    Vault,
)
from taichi_erosion.evidence.data.tables.rows import Table
from taichi_erosion.evidence.models import plugin as plugins
from taichi_erosion.evidence.models import simulator
from taichi_erosion.evidence.models.run_store import FILE, FunctionModel, RunStore
from taichi_erosion.evidence.models.simulator import Simulator
from taichi_erosion.evidence.models.table_columns import condition_units, impossible_study_values
from taichi_erosion.mechanisms.library import mechanism_rows
from taichi_erosion.scene import scene_hash

BudgetName = Literal["quick", "full"]
PLANS: tuple[BudgetName, ...] = ("quick", "full")  # of plans: each has the runs of the one before
EffectFiles = tuple[EffectFile, ...]

LONGEST_CHAIN = 20  # studies that follow one another


@dataclass(frozen=True)
class StudyOptions:
    """What a command line states; it overrides the study file, and None leaves the file's own."""

    budget: BudgetName | None = None  # size of the plan
    runs: int | None = None  # cap on the runs
    workers: int | None = None
    seed: int | None = None
    effect_files: tuple[Path, ...] = ()  # beside those that the study names; their effects are candidates
    announce: Callable[[str], None] = lambda _: None  # is told the cost of a plan before its first run
    arch: ArchChoice | None = None
    decomposition: Decomposition | None = None
    force: bool = False  # go on where a fault of the set-up keeps the answer waiting; replace foreign files


NO_OPTIONS = StudyOptions()


def plan_and_run_limit(budget: str | int | None) -> tuple[BudgetName | None, int | None]:
    """Size of the plan and cap on the runs that a user states; raises BadInput for what is neither."""
    text = str(budget)
    if budget is None:
        return None, None
    if text in PLANS:
        return PLANS[PLANS.index(text)], None
    if text.isascii() and text.isdigit() and int(text) > 0:
        return None, int(text)
    raise BadInput(f"--budget {text}: give quick, full, or the most runs, a whole number above 0")


@dataclass(frozen=True)
class Study:
    path: Path
    file: StudyFile
    problem: Problem
    results: Path  # folder of all findings
    digest: str  # of the measurements
    model: str  # name and version of the model
    store: RunStore
    notes: tuple[str, ...]  # sentences of the report about the table and the vault
    simulator: Simulator | None = None  # scenes that answer; None for a model function
    simulations: int | None = None  # that trained the emulator; None for a model function
    options: StudyOptions = NO_OPTIONS
    fresh: str = ""  # mark of runs with other seeds than those of the file; "" for the file's own
    faults: tuple[SetUpFault, ...] = ()  # of the table, and of the runs that trained the emulator
    effect_files: tuple[EffectFile, ...] = ()  # named by the study or the command

    @property
    def vault_digest(self) -> str:
        """Digest of the table from which the rows of the vault were drawn: the key of its openings."""
        return self.file.vault.drawn_from or self.digest


@dataclass(frozen=True)
class StudyModel:
    """The model of a study, and the effects that may be missing in it."""

    model: plugins.NameMapping
    identity: str  # name and version
    candidates: Sequence[Candidate]
    adopted: tuple[Candidate, ...]
    parameters: tuple[Parameter, ...] = ()  # of effects, to be calibrated with those of the study
    uncertainty: plugins.ModelErrorCovariance | None = None
    mechanisms: tuple[Mechanism, ...] = ()  # that a function declares
    simulator: Simulator | None = None
    unread: Mapping[str, str] = field(default_factory=dict)  # conditions that change no run -> what to do


def load_measurements(
    path: Path, file: StudyFile, effect_files: tuple[EffectFile, ...]
) -> tuple[Table, Measurements, list[str]]:
    """Table of a study, its rows in the units of the model, and notes on them. Raises BadInput."""
    table = read_measured_table(path.parent / file.study.measurements, file.study.measurements, file)
    return table, *study_measurements(table, file, str(path), condition_units(file, path, effect_files))


def load_study(path: Path, options: StudyOptions = NO_OPTIONS) -> Study:
    """Study of a file; reads everything that it names and simulates nothing. Raises BadInput."""
    study_document = read_evidence_study(path)
    file = override_by_options(study_document, options)
    effect_files = read_effect_files(file.study.effect_files, path.parent, str(path))
    files = tuple(dict.fromkeys((*effect_files, *read_effect_files(options.effect_files))))
    table, measurements, notes = load_measurements(path, file, files)
    if impossible := list(impossible_study_values(table, file, path.parent)):
        raise BadInput(*impossible)
    results, digest = results_folder(path, file), table_digest(measurements)
    store = RunStore(results / FILE)
    if file.study.model is not None:
        parts = load_function_model(path, file, store, files)
    else:
        parts = load_scene_model(path, file, results, measurements, files)
    vault, least = file.vault, len((*file.parameters, *parts.parameters, *parts.adopted)) + SPARE
    chosen = vault.fraction, vault.ranges, vault.drawn_from, vault.sources, least
    hidden, vault_note = draw_vault(measurements, *chosen)
    parameters = [Parameter(n, p.start, p.low, p.high, p.prior_sd_log) for n, p in file.parameters.items()]
    # laboratory and model differ in what they take for a grain, more or less by its size
    places = {name: place.split(",")[0].rpartition(".")[2] for name, place in file.conditions.items()}
    diameter = next((name for name, place in places.items() if place == "diameter"), "")
    choice, library, observables = file.candidates.mechanisms, mechanism_rows(), dict[str, Observable]()
    if missing := [name for name in choice or () if name not in library]:
        raise BadInput(f"{path}: candidates.mechanisms: '{missing[0]}' is not one of {', '.join(library)}")
    for name, entry in file.observables.items():
        errors = entry.sd_shared, entry.sd_numerical, entry.sd_shared_relative
        observables[name] = Observable(name, entry.transform, entry.floor or 0.0, *errors, diameter)
    problem = Problem(
        measurements=measurements,
        observables=observables,
        parameters=(*parameters, *parts.parameters),
        candidates=tuple(parts.candidates),
        model=parts.model,
        runs=file.budget.runs,
        vault=Vault(hidden, vault_openings(results, vault.drawn_from or digest)),
        adopted=parts.adopted,
        uncertainty=parts.uncertainty,
        mechanisms=tuple(each for each in parts.mechanisms if choice is None or each.name in choice),
        unread=tuple(parts.unread),
    )
    notes = (*notes, *filter(None, parts.unread.values()), vault_note)
    shared = path, file, problem, results, digest, parts.identity, store, notes
    fresh = "" if file.study.seed == study_document.study.seed else f"seed {file.study.seed}|"
    return Study(*shared, parts.simulator, options=options, fresh=fresh, effect_files=files)


def override_by_options(file: StudyFile, options: StudyOptions) -> StudyFile:
    """The study file with what the command line states in place of its own."""
    sections = dict.fromkeys(("workers", "arch", "decomposition"), "campaign")
    sections |= {"seed": "study", "runs": "budget"}
    for key, section in sections.items():
        if (value := getattr(options, key)) is not None:
            file = file.model_copy(update={section: getattr(file, section).model_copy(update={key: value})})
    return file


def load_function_model(path: Path, file: StudyFile, store: RunStore, files: EffectFiles) -> StudyModel:
    """Model function with its cache, and the effects of files that it takes."""
    plugin = plugins.load_plugin(str(file.study.model), path.parent, str(path))
    identity = f"{plugin.name} {plugin.version}"
    effects = plugins.load_function_effects(path, files, plugin.mechanisms)
    adopted = tuple(simulator.as_candidate(*each, effects) for each in file.adopted.items())
    tried = effects_to_try(file, str(path), effects)
    values = FunctionModel(plugin, identity, store, file.budget.runs, effects)
    # the function may have another name for an observable
    observables = {name: entry.measure or name for name, entry in file.observables.items()}
    model = plugins.NameMapping(values, dict(file.conditions), observables)
    uncertainty = plugin.covariance and plugins.ModelErrorCovariance(plugin, model, file.study.seed)
    identities = ", ".join([identity, *(f"{each.path.name} {each.digest}" for each in files)])
    unread = {n: "" for n, place in file.conditions.items() if place.startswith(simulator.CONDITIONS)}
    return StudyModel(model, identities, tried, adopted, (), uncertainty, plugin.mechanisms, unread=unread)


def load_scene_model(
    path: Path, file: StudyFile, results: Path, measurements: Measurements, files: EffectFiles
) -> StudyModel:
    """Scenes that answer; their runs stand in the ledger of a campaign."""
    runs = results if file.study.runs is None else path.parent / file.study.runs
    study_model = simulator.study_simulator(path, file, measurements, runs, files)
    tried = simulator.library_candidates(file, study_model, str(path))
    adopted = tuple(simulator.as_candidate(*each, study_model.library) for each in file.adopted.items())
    parameters = simulator.uncertain_parameters(file, study_model, measurements, (*tried, *adopted))
    paths = {number.path for number in parameters}
    scenes = dict.fromkeys(measure.scene for measure in study_model.measures.values())
    entries = study_model.measures.items()
    measures = {n: replace(m, accepted_paths=m.accepted_paths | paths) for n, m in entries}
    study_model = replace(study_model, measures=measures)
    names = [f"{scene.name} {scene_hash(study_model.load_scene_at(scene))}" for scene in scenes]
    identity = ", ".join([*names, *(f"{each.path.name} {each.digest}" for each in study_model.effect_files)])
    unread = dict(simulator.unread_conditions(file, study_model, tried))
    model = plugins.NameMapping(None, dict(file.conditions), {name: name for name in file.observables})
    return StudyModel(model, identity, tried, adopted, parameters, simulator=study_model, unread=unread)


def effects_to_try(file: StudyFile, name: str, own_effects: Mapping[str, Effect]) -> Sequence[Candidate]:
    """Effects to try, without the adopted ones: those of the list, or all that have a table, and own ones."""
    section = file.candidates
    listed = () if section.effects == (ALL,) else section.effects
    for effect in section.tables:
        if listed and effect not in (*listed, *own_effects):
            raise BadInput(f"{name}: candidates.{effect} is not in candidates.effects = {list(listed)}")
    tables, names = section.tables, dict.fromkeys((*(listed or section.tables), *own_effects))
    tried = (name for name in names if name not in file.adopted)
    return [simulator.as_candidate(each, tables.get(each, CandidateEntry()), own_effects) for each in tried]


def results_folder(path: Path, file: StudyFile) -> Path:
    """`<stem>-results` beside the study, or beside the first of the studies that it follows."""
    first, _ = first_study_of_adoptions(path, file)
    return first.with_name(f"{first.stem}-results")


def first_study_of_adoptions(path: Path, file: StudyFile) -> tuple[Path, StudyFile]:
    """The study from which adoptions made this one; itself where it follows none."""
    for _ in range(LONGEST_CHAIN):
        if file.study.follows is None:
            return path, file
        path = path.parent / file.study.follows
        file = read_evidence_study(path)
    raise BadInput(f"{path}: study.follows = '{file.study.follows}' leads in a circle")
