"""Units of a study's table, in which its numbers are told.

The statistics count in the units of the model. Whatever a person reads - a sentence, a table, a figure -
takes its numbers through `TableUnits`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

from taichi_erosion.scene.schema.units import Scale
from taichi_erosion.tables.number_words import PURE, plain, with_unit

KEY = "table_units"  # of a document
DAY = "day"  # the condition that dates become


@dataclass(frozen=True)
class TableUnits:
    """Scales of observables and of conditions, from the unit of the table to that of the model."""

    values: Mapping[str, Scale] = field(default_factory=dict)
    conditions: Mapping[str, Scale] = field(default_factory=dict)

    @staticmethod
    def of(document: Mapping[str, Any]) -> "TableUnits":
        """Units of a stored document; those of the model where it states no others."""
        stored = document.get(KEY, {})
        values = {name: Scale(unit) for name, unit in document.get("units", {}).items()}
        values |= {name: Scale(**entry) for name, entry in stored.get("values", {}).items()}
        conditions = {name: Scale(**entry) for name, entry in stored.get("conditions", {}).items()}
        return TableUnits(values, conditions)

    def value_unit(self, observable: str) -> str:
        """Unit of an observable; empty for a pure number."""
        return unit_or_empty(self.values.get(observable, Scale()))

    def condition_unit(self, name: str) -> str:
        """Unit of a condition; empty for a pure number."""
        return unit_or_empty(self.conditions.get(name, Scale()))

    def value(self, observable: str, number: float | None) -> float | None:
        """Value, or difference of values, of an observable; values are counted from 0 in every unit."""
        return None if number is None else number / self.values.get(observable, Scale()).factor

    def condition(self, name: str, number: float) -> float:
        return self.conditions.get(name, Scale()).to_unit_of_table(number)

    def value_text(self, observable: str, number: float) -> str:
        """`25.3 cm/s`."""
        scale = self.values.get(observable, Scale())
        return with_unit(plain(number / scale.factor), scale.unit)

    def condition_text(self, name: str, number: float) -> str:
        """`230 um`."""
        return with_unit(plain(self.condition(name, number)), self.condition_unit(name))

    def conditions_text(self, conditions: Mapping[str, float]) -> str:
        """`diameter = 230 um, moisture = 2 %`; conditions that were not written down are left out."""
        finite = {name: number for name, number in conditions.items() if isfinite(number)}
        return ", ".join(f"{name} = {self.condition_text(name, number)}" for name, number in finite.items())

    def condition_size_text(self, name: str, number: float) -> str:
        """A condition by which another value of it is divided: in its unit where that counts from 0."""
        scale = self.conditions.get(name, Scale())
        return plain(number) if scale.origin else self.condition_text(name, number)


def unit_or_empty(scale: Scale) -> str:
    """Unit as written; empty for a pure number."""
    return "" if scale.unit in PURE else scale.unit
