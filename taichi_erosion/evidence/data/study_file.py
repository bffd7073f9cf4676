"""A study file as typed, frozen records: the only place where defaults of a study stand."""

import tomllib
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, model_validator

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene.load import file_text, first_line, summary, with_tuples
from taichi_erosion.scene.schema.fields import Name, Part, contradiction, number
from taichi_erosion.scene.validation_messages import problem_lines

LARGEST = 1e30  # numbers beyond it are taken for a slip
ALL = "all"  # every effect of the library


class Head(Part):
    """What the study is."""

    measurements: str = Field(min_length=1, description="tidy CSV table, beside the study file")
    model: str | None = Field(
        None,
        pattern=r"^[A-Za-z_][\w.]*:[A-Za-z_]\w*$",
        description="module:function that answers instead of scenes",
    )
    title: str = Field("", max_length=200, description="one line for people")
    notes: str = Field("", max_length=20_000, description="assumptions and sources")
    seed: int = number(1, "1", "first seed of the simulations", 0, 2**31)
    runs: str | None = Field(None, min_length=1, description="folder of runs that several studies share")
    follows: str | None = Field(None, min_length=1, description="study from which `adopt` made this one")


class ObservableEntry(Part):
    """Which scene answers an observable, and on which scale its noise is near-normal."""

    scene: str | None = Field(None, min_length=1, description="scene file, beside the study file")
    measure: Name | None = Field(None, description="measure of the scene that answers; left out: same name")
    unit: str | None = Field(None, max_length=60, description="unit of the model; left out: the table's")
    transform: Literal["identity", "log", "log_floor"] = Field("identity", description="scale of comparison")
    floor: float | None = number(
        None, "unit of the observable", "least value that the instrument sees", 0.0, LARGEST
    )
    sd_shared: float = number(
        0.0, "unit of the observable", "systematic sd common to all rows of one instrument", 0.0, LARGEST
    )
    sd_shared_relative: float = number(0.0, "1", "the same, as a share of the value", 0.0, 10.0)
    sd_numerical: float = number(
        0.0, "unit of the observable", "tolerance for box, time step, coarse graining", 0.0, LARGEST
    )

    @model_validator(mode="after")
    def _floor_is_above_zero(self) -> "ObservableEntry":
        if self.transform == "log_floor" and not self.floor:
            raise contradiction("transform = 'log_floor' needs floor = the least value seen, above 0")
        return self


class ParameterEntry(Part):
    """A number that may be calibrated; its prior is lognormal around start, normal where start <= 0."""

    start: float = number(..., "unit of the parameter", "best guess", -LARGEST, LARGEST)
    low: float = number(..., "unit of the parameter", "least value", -LARGEST, LARGEST)
    high: float = number(..., "unit of the parameter", "largest value", -LARGEST, LARGEST)
    prior_sd_log: float = number(0.5, "1", "sd of the logarithm", 1e-4, 10.0)

    @model_validator(mode="after")
    def _in_order(self) -> "ParameterEntry":
        if not self.low < self.high:
            raise contradiction(f"low = {self.low:g} is not below high = {self.high:g}")
        if not self.low <= self.start <= self.high:
            raise contradiction(f"start = {self.start:g} lies outside [{self.low:g}, {self.high:g}]")
        return self


class CandidateEntry(Part):
    """An effect that may be missing; what is left out, the library says."""

    prior_scale: float | None = number(None, "1", "half-normal scale of its strength", 1e-6, 1e6)
    max: float | None = number(None, "1", "largest strength that is physical", 1e-6, 1e6)


class Candidates(Part):
    """Effects to try."""

    effects: tuple[Name, ...] = Field(default=(), description="'all', or a list of names")
    tables: dict[Name, CandidateEntry] = Field(default={}, description="what is said about single effects")


class AdoptedEntry(Part):
    """An effect that is in the model already; its strength is calibrated with the parameters."""

    strength: float = number(1.0, "1", "strength found when it was adopted", 0.0, 1e6)
    prior_scale: float | None = number(None, "1", "half-normal scale of its strength", 1e-6, 1e6)
    max: float | None = number(None, "1", "largest strength that is physical", 1e-6, 1e6)


class VaultEntry(Part):
    """Measurements that are kept out of sight until an effect is adopted."""

    fraction: float = number(0.3, "1", "share of the groups", 0.0, 0.9)
    ranges: dict[Name, tuple[float, float]] = Field(
        default={}, description="whole ranges of a condition, inclusive"
    )


class BudgetEntry(Part):
    """How much may be spent."""

    runs: int | None = number(
        None, "1", "runs: one seed at one setting of the model, over all conditions", 1, 10**9
    )


class LaboratoryEntry(Part):
    """What could be measured next."""

    ranges: dict[Name, tuple[float, float]] = Field(default={}, description="reach of each condition")
    costs: dict[Name, float] = Field(default={}, description="cost of one measurement by observable")
    repeats: int = number(3, "1", "repeats of one measurement", 1, 1000)


class StudyFile(Part):
    """One evidence study."""

    study: Head
    observables: dict[Name, ObservableEntry] = Field(min_length=1)
    conditions: dict[Name, str] = Field({})
    parameters: dict[str, ParameterEntry] = Field(default={}, max_length=20)
    adopted: dict[Name, AdoptedEntry] = Field(default={}, description="effects that are in the model already")
    candidates: Candidates = Candidates()
    vault: VaultEntry = VaultEntry()
    budget: BudgetEntry = BudgetEntry()
    laboratory: LaboratoryEntry = LaboratoryEntry()

    @model_validator(mode="after")
    def _names_are_there(self) -> "StudyFile":
        for place, ranges in (("vault", self.vault.ranges), ("laboratory", self.laboratory.ranges)):
            for name, (low, high) in ranges.items():
                if name not in self.conditions:
                    raise contradiction(f"{place}.ranges.{name} is not under [conditions]")
                if low > high:
                    raise contradiction(f"{place}.ranges.{name} = [{low:g}, {high:g}] is empty")
        for name in self.laboratory.costs:
            if name not in self.observables:
                raise contradiction(f"laboratory.costs.{name} is not under [observables]")
        return self

    @model_validator(mode="after")
    def _every_observable_is_answered(self) -> "StudyFile":
        for name, entry in self.observables.items():
            if (entry.scene is None) == (self.study.model is None):
                word = "missing, as is study.model" if entry.scene is None else "given, and study.model too"
                raise contradiction(f"observables.{name}.scene is {word}; exactly one must answer")
        return self


def read_study_file(path: Path) -> StudyFile:
    """Validated study of a TOML file; raises BadInput with one line."""
    name = str(path).replace("\n", "?")
    try:
        table = gathered(with_tuples(tomllib.loads(file_text(path, name))))
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{name}: not a TOML file: {first_line(error)}") from None
    try:
        return StudyFile.model_validate(table)
    except ValidationError as error:
        lines = problem_lines(error, table, {})
        raise BadInput(f"{name}: {summary(lines).replace('candidates.tables.', 'candidates.')}") from None
    except (OverflowError, RecursionError) as error:
        raise BadInput(f"{name}: cannot be used: {first_line(error)}") from None


def gathered(table: dict[str, Any]) -> dict[str, Any]:
    """The table with what is said about single effects put together, apart from the list of their names."""
    candidates = table.get("candidates")
    if not isinstance(candidates, dict):
        return table
    single = {name: entry for name, entry in candidates.items() if name != "effects"}
    names = candidates.get("effects", ())
    return table | {
        "candidates": {"effects": (names,) if isinstance(names, str) else names, "tables": single}
    }
