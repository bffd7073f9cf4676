"""A study file: the one schema that calibrations and evidence studies share, its reading, its editing.

A calibration needs [design] and [targets] and varies [parameters] over their ranges; an evidence study needs
`study.measurements` and a `start` for every parameter. One file may be both. Defaults of a study stand here
alone.
"""

import json
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import comb, isnan, nan
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from taichi_erosion.core.effect_file import EffectFile, read_effect_files
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import one_line_name
from taichi_erosion.core.setup import ArchChoice, Decomposition
from taichi_erosion.scene.load import error_lines, fault_lines, first_error_line, lists_to_tuples, read_toml
from taichi_erosion.scene.paths import DIALECT
from taichi_erosion.scene.physical_ranges import range_of, range_scale
from taichi_erosion.scene.schema.fields import Name, Section, entry, number
from taichi_erosion.scene.schema.units import Scale

UNIT, UNIT_OF_PARAMETER = "unit of the observable", "unit of the parameter"
LARGEST = 1e30  # numbers beyond it are taken for a slip
ALL = "all"  # every effect of the library
SURFACE_FACTORS = 3  # fewest factors of a Box-Behnken design
HYPERCUBE_RUNS = 10  # of a Latin hypercube by factor; Loeppky, Sacks & Welch (2009), Technometrics 51, 366
HYPERCUBE_MOST = 900  # with at most 100 centre points they use the 1000 seeds of a stage
SCREENED_MOST = 35  # parameters of the largest Plackett-Burman design that is run
CALIBRATED_MOST = 20  # parameters of an evidence study


class Head(Section):
    """Section [study]."""

    measurements: str = Field("", description="tidy CSV table, beside the study file")
    made_from: str = Field("", description="table from which `study new` made this study, relative to it")
    made_from_digest: str = Field("", description="digest of the cells of that table when it was read")
    model: str | None = Field(
        None,
        pattern=r"^[A-Za-z_][\w.]*:[A-Za-z_]\w*$",
        description="module:function that answers instead of scenes",
    )
    title: str = Field("", max_length=200, description="one line for people")
    notes: str = Field("", max_length=20_000, description="assumptions and sources")
    seed: int = number(1, "1", "first seed of the simulations; every run takes the next", 0, 2**31)
    runs: str | None = Field(None, min_length=1, description="folder of runs that several studies share")
    follows: str | None = Field(None, min_length=1, description="study from which `adopt` made this one")
    effect_files: tuple[str, ...] = entry(
        (), "Python files with effects of your own, relative to the study file"
    )
    settings: tuple[str, ...] = entry((), "PATH=VALUE changes of the scene for all designed runs")


class ObservableEntry(Section):
    """Scene that answers an observable, and the scale on which its noise is near-normal."""

    scene: str | None = Field(None, min_length=1, description="scene file, beside the study file")
    measure: Name | None = entry(None, "measure of the scene that answers; left out: same name")
    unit: str | None = Field(None, max_length=60, description="unit of the model; left out: the table's")
    transform: Literal["identity", "log", "log_floor"] = entry("identity", "scale of comparison")
    floor: float | None = number(None, UNIT, "least value that the instrument sees", 0.0, LARGEST)
    sd_shared: float = number(0.0, UNIT, "systematic sd common to all rows of one instrument", 0.0, LARGEST)
    sd_shared_relative: float = number(0.0, "1", "the same, as a share of the value", 0.0, 10.0)
    sd_numerical: float = number(0.0, UNIT, "tolerance for box, time step, coarse graining", 0.0, LARGEST)
    same_size: bool = entry(
        False, "the laboratory's heap has as many grains as the scene's: a small one is no fault"
    )

    def contradictions(self) -> Iterator[str]:
        if self.transform == "log_floor" and not self.floor:
            yield "transform = 'log_floor' needs floor = the least value seen, above 0"


class ParameterEntry(Section):
    """A parameter: its range, its limits in a calibration, its prior in an evidence study.

    The prior is lognormal around start, normal where start <= 0.
    """

    low: float = number(..., UNIT_OF_PARAMETER, "least value; low level when screened", -LARGEST, LARGEST)
    high: float = number(..., UNIT_OF_PARAMETER, "largest value; its high level", -LARGEST, LARGEST)
    start: float = number(nan, UNIT_OF_PARAMETER, "best guess", -LARGEST, LARGEST)
    prior_sd_log: float = number(0.5, "1", "sd of the logarithm", 1e-4, 10.0)
    least: float | None = number(None, UNIT_OF_PARAMETER, "limit of the climb; left out: low")
    most: float | None = number(None, UNIT_OF_PARAMETER, "limit of the climb; left out: high")
    unit: str = Field("1", max_length=20, description="unit of the parameter")
    symbol: str = Field("", max_length=20, description="letter in a publication")
    label: str = Field("", max_length=60, description="name for people")
    also: tuple[str, ...] = entry((), "paths that take the same value in a designed run")
    published: str = Field("", max_length=400, description="what a publication says of it")

    def contradictions(self) -> Iterator[str]:
        if not self.low < self.high:
            yield f"low = {self.low:g} is not below high = {self.high:g}"
        if not isnan(self.start) and not self.low <= self.start <= self.high:
            yield f"start = {self.start:g} lies outside [{self.low:g}, {self.high:g}]"
        if not self.limits[0] <= self.low < self.high <= self.limits[1]:
            yield f"the limits {self.limits} must hold [{self.low:g}, {self.high:g}]"

    @property
    def limits(self) -> tuple[float, float]:
        """Range that no designed run may leave."""
        least, most = self.least, self.most
        return self.low if least is None else least, self.high if most is None else most


class CandidateEntry(Section):
    """An effect that may be missing; entries left out are those of the library."""

    prior_scale: float | None = number(None, "1", "half-normal scale of its strength", 1e-6, 1e6)
    max: float | None = number(None, "1", "largest strength that is physical", 1e-6, 1e6)


class Candidates(Section):
    """Effects to try."""

    effects: tuple[Name, ...] = entry((), "'all', or a list of names")
    mechanisms: tuple[Name, ...] | None = entry(
        None, "to try where no effect suffices: all if left out, [] for none"
    )
    tables: dict[Name, CandidateEntry] = entry({}, "priors of single effects")


class AdoptedEntry(CandidateEntry):
    """An effect that is in the model already; its strength is calibrated with the parameters."""

    strength: float = number(1.0, "1", "strength found when it was adopted", 0.0, 1e6)


class VaultEntry(Section):
    """Measurements that are held out until an effect is adopted."""

    fraction: float = number(0.3, "1", "share of the groups", 0.0, 0.9)
    ranges: dict[Name, tuple[float, float]] = entry({}, "whole ranges of a condition, inclusive")
    sources: tuple[str, ...] = entry((), "sources that are held out whole, as the table has them")
    drawn_from: str | None = Field(
        default=None,
        pattern=r"^[0-9a-f]{64}$",
        description="digest of the table from which rows were drawn; it stays when the table is corrected",
    )


class BudgetEntry(Section):
    """Largest number of runs; one run is one set-up with one seed."""

    runs: int | None = number(None, "1", "most runs: of scenes over all commands, else of one", 1, 10**9)


class LaboratoryEntry(Section):
    """What could be measured next."""

    ranges: dict[Name, tuple[float, float]] = entry({}, "reach of each condition")
    costs: dict[Name, float] = entry({}, "cost of one measurement by observable")
    repeats: int = number(3, "1", "repeats of one measurement", 1, 1000)


class Target(Section):
    """Measured value that a calibration aims at."""

    value: float = number(..., UNIT, "mean of the repeats", -LARGEST, LARGEST)
    sd: float = number(..., UNIT, "standard deviation of single repeats", 0.0, LARGEST)
    n: int = number(..., "1", "number of repeats", 2, 10**9)
    unit: str = Field("", max_length=20, description=UNIT)
    source: str = Field("", max_length=400, description="where it was published")


class DesignSizes(Section):
    """Runs of every designed experiment of a calibration."""

    screen_centre: int = number(4, "1", "centre points of the screening", 0, 100)
    climb_steps: int = number(5, "1", "runs along the steepest path beyond its start", 1, 100)
    climb_step: float = number(0.4, "1", "coded step of the steepest factor", 1e-3, 10.0)
    surface: Literal["box_behnken", "central_composite", "latin_hypercube"] = entry(
        "box_behnken", "design of the surface"
    )
    surface_axial: Literal["rotatable", "spherical", "faced"] = entry(
        "rotatable", "distance of the star points of a central composite design"
    )
    surface_runs: int | None = number(
        None, "1", "runs of a Latin hypercube beside the centre; left out: ten by factor", 10, HYPERCUBE_MOST
    )
    surface_factors: int = number(3, "1", "factors that go on, largest effects first", SURFACE_FACTORS, 7)
    surface_half: float = number(0.5, "1", "half range of the surface, in that of the screening", 1e-3, 10.0)
    surface_centre: int = number(5, "1", "centre points of the surface", 1, 100)
    confirm: int = number(5, "1", "fresh seeds at the optimum", 2, 10_000)
    record: Literal["none", "confirm", "all"] = entry("none", "runs whose recordings are kept")

    def contradictions(self) -> Iterator[str]:
        for key, design in (("surface_axial", "central_composite"), ("surface_runs", "latin_hypercube")):
            if key in self.model_fields_set and self.surface != design:
                yield f"{key} needs surface = '{design}'; it is '{self.surface}'"
        fewest = comb(self.surface_factors + 2, 2)  # coefficients of a full quadratic
        if self.hypercube_runs < fewest:
            words = f"a quadratic in {self.surface_factors} factors needs at least {fewest}"
            yield f"surface_runs = {self.surface_runs}; {words}"

    @property
    def hypercube_runs(self) -> int:
        """Runs of the Latin hypercube beside its centre points."""
        return self.surface_runs or HYPERCUBE_RUNS * self.surface_factors


class WorkersEntry(Section):
    """Where designed runs are made; the command line overrides it."""

    workers: int | None = number(None, "1", "local processes; left out: one a core", 1, 10_000)
    arch: ArchChoice = entry("cpu", "device; auto: a graphics processor for large runs, if there is one")
    decomposition: Decomposition | None = entry(
        None, "what one thread advances; left out: partitions on cpu, grains elsewhere"
    )
    scheduler: str | None = Field(default=None, min_length=1, description="address of a Dask scheduler")


class StudyFile(Section):
    """One study."""

    study: Head
    observables: dict[Name, ObservableEntry] = Field(min_length=1)
    conditions: dict[Name, str] = entry({}, "column of the table -> dotted path, or name")
    columns: dict[str, Name] = entry({}, "heading of a table -> observable or condition, or 'note'")
    parameters: dict[str, ParameterEntry] = Field(default={}, max_length=SCREENED_MOST)
    adopted: dict[Name, AdoptedEntry] = entry({}, "effects that are in the model already")
    candidates: Candidates = Candidates()
    vault: VaultEntry = VaultEntry()
    budget: BudgetEntry = BudgetEntry()
    laboratory: LaboratoryEntry = LaboratoryEntry()
    targets: dict[Name, Target] = entry({}, "what a calibration aims at")
    design: DesignSizes = DesignSizes()
    campaign: WorkersEntry = WorkersEntry()

    def contradictions(self) -> Iterator[str]:
        for place, ranges in (("vault", self.vault.ranges), ("laboratory", self.laboratory.ranges)):
            for name, (low, high) in ranges.items():
                if name not in self.conditions:
                    yield f"{place}.ranges.{name} is not under [conditions]"
                if low > high:
                    yield f"{place}.ranges.{name} = [{low:g}, {high:g}] is empty"
        for place, named in (("laboratory.costs", self.laboratory.costs), ("targets", self.targets)):
            for name in named:
                if name not in self.observables:
                    yield f"{place}.{name} is not under [observables]"
        yield from self.answer_contradictions()

    def answer_contradictions(self) -> Iterator[str]:
        """Observables that nothing answers, or both a scene and the model."""
        for name, observable in self.observables.items():
            is_missing = observable.scene is None
            if is_missing == (self.study.model is None):
                word = "missing, as is study.model" if is_missing else "given, and study.model too"
                yield f"observables.{name}.scene is {word}; exactly one must answer"


@dataclass(frozen=True)
class CalibrationStudy:
    path: Path
    study: StudyFile

    @property
    def folder(self) -> Path:
        """Folder of tables, ledger and pages: beside the study file, under its name."""
        return self.path.with_suffix("")

    @property
    def effect_files(self) -> tuple[EffectFile, ...]:
        """Files of the effects that its scenes may name. Raises BadInput."""
        return read_effect_files(self.study.study.effect_files, self.path.parent, str(self.path))

    def scene(self, observable: str) -> Path:
        return self.path.parent / str(self.study.observables[observable].scene)

    @property
    def scenes(self) -> list[Path]:
        """Scenes that answer the targets."""
        return list(dict.fromkeys(self.scene(name) for name in self.study.targets))

    @property
    def labels(self) -> dict[str, str]:
        """Names of the parameters for people, by path."""
        return {path: entry.label or path for path, entry in self.study.parameters.items()}

    def measure(self, observable: str) -> str:
        return self.study.observables[observable].measure or observable


def read_calibration_study(path: Path) -> CalibrationStudy:
    """Validated calibration study; raises BadInput with one line."""
    return CalibrationStudy(path, read_study_file(path, calibration_problems))


def read_evidence_study(path: Path) -> StudyFile:
    """Validated evidence study; raises BadInput with one line."""
    return read_study_file(path, evidence_problems)


def calibration_problems(file: StudyFile) -> Iterator[str]:
    """What a calibration lacks in a valid study file."""
    for section in ("design", "targets"):
        if section not in file.model_fields_set:
            yield f"[{section}] is missing; a calibration study needs it"
    if not file.targets:
        yield "targets has 0 entries; at least 1 allowed"
    if file.study.model is not None:
        yield "study.model answers evidence studies alone; a calibration needs a scene of every observable"
    if len(file.parameters) < SURFACE_FACTORS:
        yield f"parameters has {len(file.parameters)} entries; at least {SURFACE_FACTORS} allowed"
    yield from target_unit_problems(file)
    if file.design.surface_factors > len(file.parameters):
        yield f"design.surface_factors exceeds the {len(file.parameters)} parameters"


def target_unit_problems(file: StudyFile) -> Iterator[str]:
    """Targets in another unit than that of their measures."""
    for name, target in file.targets.items():
        allowed = range_of(getattr(file.observables.get(name), "measure", None) or name)
        scale = range_scale(target.unit, allowed) if allowed else Scale()
        if allowed and (scale is None or scale.to_use(1.0) != 1.0):
            yield f"targets.{name}.unit = '{target.unit}': its measure counts in {allowed.unit}; write that"


def evidence_problems(file: StudyFile) -> Iterator[str]:
    """What an evidence study lacks in a valid study file, and what it holds that only a calibration reads."""
    if not file.study.measurements:
        yield "study.measurements is missing"
    yield from (f"parameters.{key}.start is missing" for key, e in file.parameters.items() if isnan(e.start))
    for column, paths in file.conditions.items():
        for path in map(str.strip, paths.split(",")):
            if path in file.parameters:
                reason = "a number that the table states is not calibrated; leave out one of the two"
                yield f"parameters.{path}: column '{column}' sets it too: {reason}"
    if len(file.parameters) > CALIBRATED_MOST:
        yield f"parameters has {len(file.parameters)} entries; at most {CALIBRATED_MOST} allowed"
    calibration_only = [f"parameters.{name}.also" for name, entry in file.parameters.items() if entry.also]
    for place in calibration_only or (["study.settings"] if file.study.settings else []):
        yield f"{place} is read by a calibration alone; state the value in the scene"


def read_study_file(path: Path, problems: Callable[[StudyFile], Iterator[str]]) -> StudyFile:
    """Study of a TOML file in which `problems` finds none; raises BadInput with one line."""
    name = one_line_name(path)
    table = lists_to_tuples(read_toml(path, "study"))
    if isinstance(candidates := table.get("candidates"), dict):  # sections of single effects go apart
        single = {key: entry for key, entry in candidates.items() if key not in ("effects", "mechanisms")}
        names = candidates.get("effects", ())
        listed = {"effects": (names,) if isinstance(names, str) else names, "tables": single}
        listed |= {key: candidates[key] for key in ("mechanisms",) if key in candidates}
        table = table | {"candidates": listed}
    try:
        file = StudyFile.model_validate(table)
    except ValidationError as error:
        lines = [line.replace("candidates.tables.", "candidates.") for line in error_lines(error, table)]
        raise BadInput(*fault_lines(name, lines)) from None
    except (OverflowError, RecursionError) as error:
        raise BadInput(f"{name}: cannot be used: {first_error_line(error)}") from None
    if lines := list(problems(file)):
        raise BadInput(*fault_lines(name, lines))
    return file


def with_entry(text: str, path: Sequence[str], value: float | str | list[str], note: str = "") -> str:
    """A TOML text with one entry set; all others stay as they are, with their comments. Raises BadInput.

    A comment beside a changed entry goes: it describes the old value. `note` takes its place.
    """
    import tomlkit
    from tomlkit.exceptions import TOMLKitError
    from tomlkit.items import InlineTable

    *sections, last = path
    try:
        document: Any = tomlkit.parse(text)
        table = document
        for key in sections:
            if key not in table:
                table[key] = tomlkit.table(is_super_table=key is not sections[-1])
            table = table[key]
        if last not in table or table[last] != value:
            table[last] = value
            is_inline = isinstance(table, InlineTable)  # a comment would hide its end
            set_entry_comment(table[last], "" if is_inline else note)
        result = tomlkit.dumps(document)
        if value_at_keys(tomllib.loads(result), path) == value:
            return result
    except (TOMLKitError, TypeError, ValueError):
        pass
    raise BadInput(f"{'.'.join(path)}: could not be set to {value!r} in the file; set it by hand")


def set_entry_comment(item: Any, note: str) -> None:
    """Replace the comment beside an entry; an empty note removes it."""
    item.trivia.comment, item.trivia.comment_ws = (f"# {note}", "  ") if note else ("", "")


def value_at_keys(table: Any, keys: Sequence[str]) -> Any:
    """What stands in a raw table below some keys, None where there is nothing."""
    for key in keys:
        table = table.get(key) if isinstance(table, dict) else None
    return table


def study_schema() -> dict[str, Any]:
    """Schema of a study file as it is written: single candidates stand beside the list of their names."""
    schema: dict[str, Any] = {"$schema": DIALECT} | StudyFile.model_json_schema()
    schema["title"] = "taichi_erosion study"
    candidates = schema["$defs"]["Candidates"]
    tables = candidates["properties"].pop("tables")
    names = candidates["properties"]["effects"]
    listed = {key: names[key] for key in ("type", "items")}
    either = {"anyOf": [{"const": ALL}, listed], "description": names["description"], "default": []}
    candidates["properties"]["effects"] = either
    candidates["additionalProperties"] = next(iter(tables["patternProperties"].values()))
    del schema["$defs"]["ParameterEntry"]["properties"]["start"]["default"]  # no number
    return schema


def write_study_schema(path: Path) -> None:
    """Write the schema file that study files name on their first line."""
    text = json.dumps(study_schema(), indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
