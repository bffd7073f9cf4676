"""Table of a study as its page shows it: conditions in the units of the table, sources of every row."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite, nan
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.study_file import StudyFile
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.measured import (
    condition_scales,
    group_of,
    read_table,
    refuse_absent,
    used_conditions,
)
from taichi_erosion.evidence.data.number_words import heading, plain, with_unit
from taichi_erosion.evidence.data.tables.tidy_table import Row
from taichi_erosion.evidence.models.column_units import place_units

Record = Mapping[str, Any]
Key = tuple[str, str, tuple[str, ...]]


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

    def behind(self, rows: Record, place: int) -> Sequence[Row]:
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
