"""A calibration study as typed, frozen records: what is varied, what is aimed at, which designs are run.

The sections [observables] and [parameters] are those of an evidence study; [design] and [targets] make it a
calibration. Sections that only the evidence commands read are left to them.
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, model_validator

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene.load import file_text, first_line, summary, with_tuples
from taichi_erosion.scene.schema.fields import Name, Part, contradiction, number
from taichi_erosion.scene.validation_messages import problem_lines

LARGEST = 1e30  # numbers beyond it are taken for a slip
OF_EVIDENCE = ("conditions", "candidates", "adopted", "vault", "budget", "laboratory")
SURFACE_FACTORS = 3  # fewest factors of a Box-Behnken design


class Head(Part):
    """What the study is."""

    title: str = Field("", max_length=200, description="one line for people")
    notes: str = Field("", max_length=20_000, description="assumptions and sources")
    seed: int = number(1, "1", "first seed; every run takes the next", 0, 2**31)
    measurements: str | None = Field(None, description="table that the evidence commands compare with")
    settings: tuple[str, ...] = Field((), description="PATH=VALUE changes of the scene for all runs")


class Answer(Part):
    """Which scene answers an observable."""

    scene: str = Field(min_length=1, description="scene file, beside the study file")


class Varied(Part):
    """A parameter and the range over which it is screened; it may leave the range up to its limits."""

    low: float = number(..., "unit of the parameter", "low level of the screening", -LARGEST, LARGEST)
    high: float = number(..., "unit of the parameter", "high level of the screening", -LARGEST, LARGEST)
    least: float | None = number(None, "unit of the parameter", "limit of the climb; left out: low")
    most: float | None = number(None, "unit of the parameter", "limit of the climb; left out: high")
    start: float | None = number(None, "unit of the parameter", "best guess, for the evidence commands")
    prior_sd_log: float | None = number(None, "1", "for the evidence commands", 1e-4, 10.0)
    unit: str = Field("1", max_length=20, description="unit of the parameter")
    symbol: str = Field("", max_length=20, description="letter in a publication")
    label: str = Field("", max_length=60, description="name for people")
    also: tuple[str, ...] = Field((), description="paths that take the same value")
    published: str = Field("", max_length=400, description="what a publication says of it")

    @model_validator(mode="after")
    def _in_order(self) -> "Varied":
        if not self.low < self.high:
            raise contradiction(f"needs low < high, got {self.low:g} and {self.high:g}")
        if not self.limits[0] <= self.low < self.high <= self.limits[1]:
            raise contradiction(f"the limits {self.limits} must hold [{self.low:g}, {self.high:g}]")
        return self

    @property
    def limits(self) -> tuple[float, float]:
        """Range that no run may leave."""
        return (
            self.low if self.least is None else self.least,
            self.high if self.most is None else self.most,
        )


class Target(Part):
    """What a laboratory measured."""

    value: float = number(..., "unit of the observable", "mean of the repeats", -LARGEST, LARGEST)
    sd: float = number(..., "unit of the observable", "standard deviation of single repeats", 0.0, LARGEST)
    n: int = number(..., "1", "number of repeats", 2, 10**9)
    unit: str = Field("", max_length=20, description="unit of the observable")
    source: str = Field("", max_length=400, description="where it was published")


class Plan(Part):
    """How many runs of what kind."""

    screen_centre: int = number(4, "1", "centre points of the screening", 0, 100)
    climb_steps: int = number(5, "1", "runs along the steepest path beyond its start", 1, 100)
    climb_step: float = number(0.4, "1", "coded step of the steepest factor", 1e-3, 10.0)
    surface_factors: int = number(3, "1", "factors that go on, largest effects first", SURFACE_FACTORS, 7)
    surface_half: float = number(0.5, "1", "half range of the surface, in that of the screening", 1e-3, 10.0)
    surface_centre: int = number(5, "1", "centre points of the surface", 1, 100)
    confirm: int = number(5, "1", "fresh seeds at the optimum", 2, 10_000)
    record: Literal["none", "confirm", "all"] = Field("none", description="runs whose recordings are kept")


class Place(Part):
    """Where the runs are made; what the command line says goes before."""

    workers: int | None = number(None, "1", "local processes; left out: one a core", 1, 10_000)
    scheduler: str | None = Field(default=None, min_length=1, description="address of a Dask scheduler")


class Study(Part):
    """One calibration study."""

    study: Head
    observables: dict[Name, Answer] = Field(min_length=1)
    parameters: dict[str, Varied] = Field(min_length=SURFACE_FACTORS, max_length=35)
    targets: dict[Name, Target] = Field(min_length=1)
    design: Plan
    campaign: Place = Place()

    @model_validator(mode="after")
    def _fits_together(self) -> "Study":
        for name in self.targets:
            if name not in self.observables:
                raise contradiction(f"targets.{name} is not under [observables]")
        if self.design.surface_factors > len(self.parameters):
            raise contradiction(f"design.surface_factors exceeds the {len(self.parameters)} parameters")
        return self


@dataclass(frozen=True)
class StudyFile:
    """A study and where it lies."""

    path: Path
    study: Study

    @property
    def folder(self) -> Path:
        """Where tables, ledger and pages of the study go: beside its file, under its name."""
        return self.path.with_suffix("")

    def scene(self, observable: str) -> Path:
        """Scene that answers an observable."""
        return self.path.parent / self.study.observables[observable].scene


def read_study(path: Path) -> StudyFile:
    """Validated study of a TOML file; raises BadInput with one line."""
    name = str(path).replace("\n", "?")
    try:
        table: dict[str, Any] = with_tuples(tomllib.loads(file_text(path, name)))
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{name}: not a TOML file: {first_line(error)}") from None
    own = {section: entry for section, entry in table.items() if section not in OF_EVIDENCE}
    for section in ("design", "targets"):
        if section not in own:
            raise BadInput(f"{name}: [{section}] is missing; a calibration study needs it")
    try:
        return StudyFile(path, Study.model_validate(own))
    except ValidationError as error:
        raise BadInput(f"{name}: {summary(problem_lines(error, own, {}))}") from None
