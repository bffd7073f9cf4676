"""Cross tables: one condition down, another across, measured values inside; refused with a remedy.

The headings of such a table hold values of a condition (`0 %`, `1 %`; `angle at 0.5 mm`, `angle at 1 mm`), or
the row below them does. Read as repeats of one measurement they would lose that condition without a word.
"""

import re
from collections.abc import Container, Iterator
from math import isnan

from taichi_erosion.evidence.data.physical_ranges import observed_range
from taichi_erosion.evidence.data.tables.cell_numbers import is_missing, is_quantity
from taichi_erosion.evidence.data.tables.column_roles import Column
from taichi_erosion.evidence.data.tables.headings import VOLUMETRIC, unit_in
from taichi_erosion.evidence.data.tables.spreadsheet import Cells
from taichi_erosion.scene.schema.units import parse_scale, parse_unit

BRACKETED_UNIT = re.compile(r"\[[^\]]*\]|\([^()\d]*\)")  # of what the column measures
VALUE = re.compile(r"(?<![\w.,])(\d+(?:[.,]\d+)?)\s*([%‰°µμ]\w*|[^\W\d_]\w*)?")
SHOWN = 3  # headings that are told
REMEDY = (
    "write one row for every measured value, with a column for each condition and one for the measured "
    "quantity"
)


def cross_table_faults(cells: Cells, columns: list[Column], stated: Container[int] = ()) -> Iterator[str]:
    """Why a table seems to be a cross table; nothing for any other.

    `stated`: columns of which the user says what they are.
    """
    families: dict[tuple[str, str], dict[str, Column]] = {}
    for column in columns:
        found = list(VALUE.finditer(text := BRACKETED_UNIT.sub(" ", column.heading.text)))
        if len(found) == 1 and column.numeric and isnan(column.height) and column.place not in stated:
            number, unit = found[0].groups()
            rest = " ".join(f"{text[: found[0].start()]} {text[found[0].end() :]}".split())
            families.setdefault((rest, (unit and unit_in(unit)) or ""), {})[number] = column
    measured = any(column.role == "observable" for column in columns)
    for (rest, unit), family in families.items():
        if len(family) > 1 and holds_condition(next(iter(family.values())), rest, unit, measured):
            texts = [f"'{column.heading.text}'" for column in family.values()]
            told = ", ".join(texts[:SHOWN]) + (", ..." if len(texts) > SHOWN else "")
            hint = "" if measured else "; repeats side by side are headed 'angle 1', 'angle 2'"
            words = f"headings {told} seem to hold values of a condition (a cross table): {REMEDY}{hint}"
            yield f"{cells.file}: {words}"
            return
    yield from second_row_faults(cells, columns)


def holds_condition(column: Column, rest: str, unit: str, measured: bool) -> bool:
    """Whether columns whose headings differ in a number alone hold one measured quantity at its values.

    Where a table names its measured quantity elsewhere, such columns are remarks (sieve fractions).
    """
    if column.role == "observable":
        allowed = observed_range(column.name)
        own = allowed and unit not in ("", VOLUMETRIC) and parse_scale(unit).kind
        return bool(unit) and not (allowed and own == parse_unit(allowed.unit).kind)  # `Winkel 1 °` is none
    alone = len(rest.strip(" =:()")) <= 1  # `2`, `w = 2`
    return not measured and column.role == "remark" and (alone or bool(unit))


def second_row_faults(cells: Cells, columns: list[Column]) -> Iterator[str]:
    """A row right below the headings with numbers in columns of one measured quantity and nowhere else."""
    names = [column.name for column in columns if column.role == "observable"]
    repeated = {column.place for column in columns if names.count(column.name) > 1}
    if not repeated or not any(column.role == "condition" for column in columns) or not cells.lines:
        return
    line, row = cells.lines[0]
    filled = {place for place, cell in enumerate(row) if not is_missing(cell)}
    if len(filled) > 1 and filled <= repeated and all(is_quantity(row[place]) for place in filled):
        yield (
            f"{cells.file}: row {line} has numbers without any condition below headings of one measured "
            f"quantity, as if they were values of a condition (a cross table): {REMEDY}"
        )
