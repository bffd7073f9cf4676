"""Stored results of a study that belong together: the models that they compare, and the study's table."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite, nan
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.study_file import StudyFile, read_evidence_study
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers import documents
from taichi_erosion.evidence.data.measured import (
    condition_scales,
    group_of,
    read_table,
    refuse_absent,
    used_conditions,
)
from taichi_erosion.evidence.data.number_words import heading, plain, with_unit
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.data.tables.tidy_table import Row
from taichi_erosion.evidence.models.column_units import place_units
from taichi_erosion.evidence.models.load_study import results_folder
from taichi_erosion.report.words import effect_words, listed

Document = Mapping[str, Any]
Key = tuple[str, str, tuple[str, ...]]

COMMANDS: tuple[documents.Command, ...] = ("discover", "compare", "adopt", "next")  # the fullest first
ANSWERS = {"discover", "compare", "adopt"}
TIES = {"group": ", one of several that fit", "unstable": ", not borne out by other runs"}
CONTROLS = {"best_wrong": "control: best other effect", "random_wrong": "control: effect drawn at random"}


@dataclass(frozen=True)
class Condition:
    """A condition in the unit of the table."""

    name: str
    path: str = ""  # in the scene, or its name in the model
    unit: str = ""
    factor: float = 1.0
    origin: float = 0.0  # value in the model's unit of the table's 0

    def shown(self, value: float | None) -> float:
        """Value in the unit of the table; NaN for one that was not written down."""
        return nan if value is None else (value - self.origin) / self.factor

    def words(self, value: float | None) -> str:
        """`moisture 1.5 %`."""
        name = self.name.replace("_", " ")
        if value is None:
            return f"{name} not stated"
        return f"{name} {with_unit(plain(self.shown(value)), self.unit)}"

    @property
    def label(self) -> str:
        """`diameter [mm]`."""
        return heading(self.name.replace("_", " "), self.unit)


@dataclass(frozen=True)
class MeasuredTable:
    """Conditions of a study, and the rows of its table behind every measured value."""

    conditions: Mapping[str, Condition]
    rows: Mapping[Key, Sequence[Row]] = field(default_factory=dict)

    def condition(self, name: str) -> Condition:
        """A condition by its column."""
        return self.conditions.get(name, Condition(name))

    def values(self, name: str) -> Sequence[float]:
        """Values of a condition in the rows of the table, in the unit of the model."""
        place = list(self.conditions).index(name)
        return [float(key[2][place]) for key in self.rows if key[2][place]]

    def behind(self, rows: Document, place: int) -> Sequence[Row]:
        """Rows of the table behind one row of a result; none where the table has changed since."""
        values = [column[place] for column in rows["conditions"].values()]
        return self.rows.get(key_of(rows["observable"][place], rows["group"][place], values), ())


def key_of(observable: str, group: str, values: Sequence[float | None]) -> Key:
    """Key of a measured value of a study."""
    known = (value if value is not None and isfinite(value) else None for value in values)
    return observable, group, tuple("" if value is None else f"{value:.9g}" for value in known)


def measured_table(study: Path, file: StudyFile) -> MeasuredTable:
    """Table of a study; without rows where it cannot be read any more."""
    try:
        table = read_table(study.parent / file.study.measurements, file.study.measurements, file)
        refuse_absent(table, file, str(study))
        scales = condition_scales(table, file, place_units(file, study))
    except (BadInput, OSError):
        return MeasuredTable({name: Condition(name, path) for name, path in file.conditions.items()})
    conditions = {
        name: Condition(name, file.conditions[name], scale.unit, scale.factor, scale.origin)
        for name, scale in scales.items()
    }
    rows: dict[Key, list[Row]] = {}
    for row in table.rows:
        used = used_conditions(row, table, scales)
        rows.setdefault(key_of(row.observable, group_of(row, used), list(used.values())), []).append(row)
    return MeasuredTable(conditions, rows)


@dataclass(frozen=True)
class Layer:
    """One model in the figures: its values on the fitted rows and, of an open vault, on the held-out ones."""

    key: str
    label: str
    fitted: Document
    held: Document | None = None
    shown: bool = True


@dataclass(frozen=True)
class Results:
    """Stored results of a study that rest on the same table."""

    study: Path
    by_command: Mapping[str, Document]  # the fullest first
    table: MeasuredTable
    adoptions: Sequence[Document] = ()
    outdated: tuple[str, ...] = ()  # commands whose answer rests on another table
    prediction: Document | None = None  # of the adopted model where there is one

    @property
    def first(self) -> Document:
        """Fullest result."""
        return next(iter(self.by_command.values()))

    @property
    def units(self) -> TableUnits:
        """Units of the table."""
        return TableUnits.of(self.first)

    @property
    def comparison(self) -> Document | None:
        """Result of compare."""
        return self.by_command.get("compare")

    @property
    def discovery(self) -> Document | None:
        """Result of discover."""
        return self.by_command.get("discover")

    @property
    def adoption(self) -> Document | None:
        """Result of adopt."""
        return self.by_command.get("adopt")

    @property
    def where(self) -> Sequence[Document]:
        """Places of the misfit of the bare model, worst first."""
        found = self.comparison or self.discovery or self.adoption
        return found.get("where", ()) if found else ()


def stored_results(study: Path) -> Results:
    """Stored results of a study. Raises BadInput where there are none.

    Answers of several commands belong together where they rest on the same measurements; of others the
    newest counts.
    """
    file = read_evidence_study(study)
    folder = results_folder(study, file)
    found: dict[documents.Command, documents.Document] = {
        command: document
        for command in COMMANDS
        if (document := documents.read_answer(folder, study.stem, command)) is not None
    }
    if not found.keys() & ANSWERS:
        raise BadInput(f"{study}: no results yet; run compare, discover or adopt on it first")
    times = {
        command: documents.document_file(folder, study.stem, command).stat().st_mtime for command in found
    }
    newest = max(found, key=lambda command: times[command])
    digest = found[newest]["digest"]
    current = {command: document for command, document in found.items() if document["digest"] == digest}
    outdated = tuple(command for command in found if command not in current)
    table, rungs = measured_table(study, file), documents.ladder(folder, digest)
    return Results(study, current, table, rungs, outdated, prediction_of(study, folder, current))


def prediction_of(study: Path, folder: Path, current: Mapping[str, Document]) -> documents.Document | None:
    """Stored predictions of the adopted model, else of the study itself, where they rest on its table."""
    adopted = [Path(current["adopt"]["written"]).stem] if "adopt" in current else []
    for stem in (*adopted, study.stem):
        found = documents.read_answer(folder, stem, "predict")
        if found is not None and found["digest"] == next(iter(current.values()))["digest"]:
            return found
    return None


def layers(found: Results) -> list[Layer]:
    """Models that the results compare: before, after, and the controls of an adoption."""
    adoption, discovery, comparison = found.adoption, found.discovery, found.comparison
    if adoption:
        return list(layers_of_adoption(adoption))
    if discovery:
        before = Layer("before", "model", discovery["rows_before"])
        with_ = discovery.get("calibrated_with", ())
        if not with_:
            return [before]
        names = listed([effect_words(name) for name in with_])
        tie = TIES.get(discovery["verdict"], "")
        return [before, Layer("after", f"model with {names}{tie}", discovery["rows_after"])]
    assert comparison is not None
    return [Layer("before", "model", comparison["rows"])]


def layers_of_adoption(adoption: Document) -> Iterator[Layer]:
    """Models before and after an adoption, and its controls."""
    named = listed([effect_words(name) for name in adoption["added"]["effects"]])
    labels = {"base": ("before", "model before"), "added": ("after", f"model with {named}")}
    for key in CONTROLS:
        if adoption.get(key):
            wrong = listed([effect_words(name) for name in adoption[key]["effects"]])
            labels[key] = (key, f"control: {wrong}")
    for key, (layer, label) in labels.items():
        fit = adoption[key]
        yield Layer(layer, label, fit["rows"], fit["vault_rows"], shown=key in ("base", "added"))
