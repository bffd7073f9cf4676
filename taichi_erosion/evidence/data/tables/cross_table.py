"""Cross tables: one condition down, another across, measured values inside; refused with a remedy.

The headings of such a table hold values of a condition (`0 %`, `1 %`; `angle at 0.5 mm`, `angle at 1 mm`), or
the row below them does. Read as repeats of one measurement they would lose that condition without a word.
"""

import re
from collections.abc import Container, Iterator
from dataclasses import dataclass
from math import isnan

from taichi_erosion.evidence.data.physical_ranges import observed_range
from taichi_erosion.evidence.data.tables.cell_numbers import MISSING, is_quantity, plain_cell
from taichi_erosion.evidence.data.tables.column_roles import Column
from taichi_erosion.evidence.data.tables.headings import VOLUMETRIC, unit_in
from taichi_erosion.evidence.data.tables.spreadsheet import Cells
from taichi_erosion.scene.schema.units import parse_scale, parse_unit

BRACKETED_UNIT = re.compile(r"\[[^\]]*\]|\([^()\d]*\)")  # of what the column measures
VALUE = re.compile(r"(?<![\w.,])(?P<number>\d+(?:[.,]\d+)?)\s*(?P<unit>[%‰°µμ]\w*|[^\W\d_]\w*)?")
SHOWN = 3  # headings that are told
REMEDY = (
    "write one row for every measured value, with a column for each condition and one for the measured "
    "quantity"
)


@dataclass(frozen=True)
class HeadingValue:
    """A value that a heading holds: `angle at # mm` with 0.5."""

    template: str
    number: float
    unit: str = ""  # in the spelling of this program; empty: none


def cross_table_faults(cells: Cells, columns: list[Column], stated: Container[int] = ()) -> Iterator[str]:
    """Why a table seems to be a cross table; nothing for any other.

    `stated`: columns of which the user says what they are.
    """
    families: dict[tuple[str, str], list[tuple[Column, HeadingValue]]] = {}
    for column in columns:
        value = heading_value(column.heading.text)
        if value is not None and column.numeric and isnan(column.height) and column.place not in stated:
            families.setdefault((value.template, value.unit), []).append((column, value))
    measured = any(column.role == "observable" for column in columns)
    for family in families.values():
        if holds_condition(family, measured):
            texts = [f"'{column.heading.text}'" for column, _ in family]
            told = ", ".join(texts[:SHOWN]) + (", ..." if len(texts) > SHOWN else "")
            hint = "" if measured else "; repeats side by side are headed 'angle 1', 'angle 2'"
            words = f"headings {told} seem to hold values of a condition (a cross table): {REMEDY}{hint}"
            yield f"{cells.file}: {words}"
            return
    yield from second_row_faults(cells, columns)


def heading_value(text: str) -> HeadingValue | None:
    """The one number in a heading and the unit right behind it; None without one or with several."""
    found = list(VALUE.finditer(BRACKETED_UNIT.sub(" ", text)))
    if len(found) != 1:
        return None
    match = found[0]
    unit = unit_in(match["unit"]) if match["unit"] else None
    template = " ".join(f"{match.string[: match.start()]} # {match.string[match.end() :]}".split())
    return HeadingValue(template, float(match["number"].replace(",", ".")), unit or "")


def holds_condition(family: list[tuple[Column, HeadingValue]], measured: bool) -> bool:
    """Whether columns whose headings differ in a number alone hold one measured quantity at its values.

    Where a table names its measured quantity elsewhere, such columns are remarks (sieve fractions).
    """
    if len({value.number for _, value in family}) < max(2, len(family)):
        return False
    column, value = family[0]
    if column.role == "observable":
        return bool(value.unit) and not counts_in(value.unit, column.name)
    alone = len(value.template.replace("#", "").strip(" =:()")) <= 1  # `2`, `w = 2`
    return not measured and column.role == "remark" and (alone or bool(value.unit))


def counts_in(unit: str, observable: str) -> bool:
    """Whether a unit may be that of the measured quantity itself: `Winkel 1 °`."""
    allowed = observed_range(observable)
    if allowed is None or unit == VOLUMETRIC:
        return False
    return parse_scale(unit).kind == parse_unit(allowed.unit).kind


def second_row_faults(cells: Cells, columns: list[Column]) -> Iterator[str]:
    """A row right below the headings with numbers in columns of one measured quantity and nowhere else."""
    names = [column.name for column in columns if column.role == "observable"]
    repeated = {column.place for column in columns if names.count(column.name) > 1}
    conditions = [column.place for column in columns if column.role == "condition"]
    if not repeated or not conditions or not cells.lines:
        return
    line, row = cells.lines[0]
    filled = {place for place, cell in enumerate(row) if plain_cell(cell).lower() not in MISSING}
    if len(filled) > 1 and filled <= repeated and all(is_quantity(row[place]) for place in filled):
        yield (
            f"{cells.file}: row {line} has numbers without any condition below headings of one measured "
            f"quantity, as if they were values of a condition (a cross table): {REMEDY}"
        )
