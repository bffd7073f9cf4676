"""A laboratory's own table in the tidy form of `measured.py`: one row for every measured value.

Every cell keeps the row of the file it comes from, so that messages point into the laboratory's file.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Literal

from taichi_erosion.evidence.data.tables.cell_numbers import (
    NO_TRANSPORT,
    ONE_NUMBER,
    CellFault,
    CellNumber,
    is_range,
    plain_cell,
    read_cell,
)
from taichi_erosion.evidence.data.tables.column_roles import SHARES, Column
from taichi_erosion.evidence.data.tables.spreadsheet import Cells
from taichi_erosion.evidence.data.tables.vocabulary import is_summary
from taichi_erosion.scene.schema.units import UnknownUnit, conversion, parse_scale, parse_unit

FORMAT = ("observable", "value", "sd", "n", "unit", "group")  # columns of a tidy table before its conditions
SHOWN = 40  # characters of a cell that a message repeats


@dataclass(frozen=True)
class Choices:
    """What the table itself does not say."""

    scatter: Literal["sd", "se"] = "sd"  # what a number behind `±` is
    names: Mapping[int, str] | None = None  # tidy names of conditions, by place


def tidy_cells(cells: Cells, columns: Sequence[Column], choices: Choices, faults: list[str]) -> Cells:
    """The tidy table of what can be read; all faults of its cells are added to `faults`."""
    observables = [column for column in columns if column.role == "observable"]
    conditions = [column for column in columns if column.role == "condition"]
    table = LaboratoryTable(cells, columns, choices)
    headings = [condition_heading(column, choices, table.cell_unit(column)) for column in conditions]
    errors = [(c, e) for c in conditions for e in columns if e.role == "condition_sd" and e.name == c.name]
    headings += [
        "sd of " + condition_heading(column, choices, table.cell_unit(column)) for column, _ in errors
    ]
    faults += copy_faults(cells, columns)
    rows = []
    for line, row in cells.lines:
        summary = next((cell for cell in row if is_summary(cell)), None)
        if summary is not None:
            faults.append(f"{cells.file}: row {line}, '{summary}': the row sums up others; remove it")
            continue
        values = [table.condition(line, row, column, faults) for column in conditions]
        values += [table.condition_error(line, row, error, column, faults) for column, error in errors]
        ends = [*values, table.source(line, row)]
        for column in observables:
            measured = table.measured(line, row, column, faults)
            if measured is not None:
                rows.append((line, (column.name, *measured, table.group(row), *ends)))
    if not rows and not faults:
        faults.append(f"{cells.file}: has a heading but no measured value")
    heading = (cells.rows[0][0], (*FORMAT, *headings, "source"))
    return Cells(cells.file, (heading, *rows), False, cells.form)


def copy_faults(cells: Cells, columns: Sequence[Column]) -> Iterator[str]:
    """Rows that stand twice; equal single values may be two repeats, equal means with their scatter not."""
    telling = any(column.role in ("sd", "se", "cv", "n") for column in columns)
    seen: dict[tuple[str, ...], int] = {}
    for line, row in cells.lines if telling else ():
        first = seen.setdefault(row, line)
        if first != line:
            yield f"{cells.file}: row {line} repeats row {first} cell by cell; remove one of them"


def condition_heading(column: Column, choices: Choices, unit: str) -> str:
    """Heading of a condition in the tidy table."""
    name = (choices.names or {}).get(column.place) or tidy_name(column.name)
    return f"{name} [{unit}]" if unit else name


def tidy_name(place: str) -> str:
    """Name of a column that sets a place of a scene: `moisture` for `conditions.moisture`."""
    if place == "grains.size.diameter":
        return "diameter"
    if place.startswith(("contact.", "materials.")):
        return place.split(",")[0].rpartition(".")[2]
    return place.removeprefix("conditions.").split(",")[0].replace(".", "_").replace("-", "_")


@dataclass(frozen=True)
class LaboratoryTable:
    """Cells with the meaning of their columns."""

    cells: Cells
    columns: Sequence[Column]
    choices: Choices

    def number(self, line: int, row: Sequence[str], column: Column, faults: list[str]) -> CellNumber | None:
        """Number of a cell, None and a fault where there is none."""
        text = row[column.place]
        try:
            return read_cell(text, self.cells.decimal_comma)
        except CellFault as fault:
            faults.append(f"{self.where(line, column)} = {shown(text)} {fault}")
            return None

    def single(self, line: int, row: Sequence[str], column: Column, faults: list[str]) -> CellNumber | None:
        """One number; None and a fault for a limit or a range, which only a measured value may be."""
        text = row[column.place]
        found = None if is_range(plain_cell(text)) else self.number(line, row, column, faults)
        if is_range(plain_cell(text)) or (found is not None and found.limit):
            faults.append(f"{self.where(line, column)} = {shown(text)} {ONE_NUMBER}")
            return None
        return found

    def where(self, line: int, column: Column) -> str:
        """Place of a cell in words."""
        return f"{self.cells.file}: row {line}, {column.heading.text}"

    def unit(self, column: Column) -> str:
        """Unit of a column: of its heading, else as chosen."""
        return column.heading.unit

    def cell_unit(self, column: Column) -> str:
        """Unit of a column, else the first one that stands behind a number in it."""
        found = self.unit(column)
        for _, row in self.cells.lines if not found else ():
            try:
                found = found or read_cell(row[column.place], self.cells.decimal_comma).unit
            except CellFault:
                continue
        return found

    def factor(self, line: int, column: Column, written: str, faults: list[str]) -> float:
        """Factor from the unit behind a number to that of its column."""
        unit = self.cell_unit(column)
        if not written or written == unit:
            return column.factor
        try:
            factor = conversion(parse_unit(written), parse_scale(unit)) if unit else None
        except UnknownUnit as error:
            hint = error.hint or "write the number alone"
            faults.append(f"{self.where(line, column)}: unit '{written}' is not known; {hint}")
            return column.factor
        if factor is None:
            told = f"in a column in {unit}" if unit else "in a column without unit"
            faults.append(f"{self.where(line, column)}: a number in {written} {told}")
        return (factor or 1.0) * column.factor

    def condition(self, line: int, row: Sequence[str], column: Column, faults: list[str]) -> str:
        """Number of a condition in the unit of its column."""
        found = self.single(line, row, column, faults)
        if found is None:
            return ""
        return scaled(found.value, self.factor(line, column, found.unit, faults))

    def condition_error(
        self, line: int, row: Sequence[str], error: Column, column: Column, faults: list[str]
    ) -> str:
        """Standard deviation of a condition in the unit of the condition's column."""
        found = self.single(line, row, error, faults)
        if found is None or not found.value:
            return ""
        return scaled(found.value, self.factor(line, column, found.unit or error.heading.unit, faults))

    def measured(
        self, line: int, row: Sequence[str], column: Column, faults: list[str]
    ) -> tuple[str, str, str, str] | None:
        """Value, sd, n and unit of an observable; None for an empty cell."""
        if plain_cell(row[column.place]).lower() in NO_TRANSPORT:
            return "no transport", "", "", self.cell_unit(column)
        found = self.number(line, row, column, faults)
        if found is None or not found.value:
            return None
        factor = self.factor(line, column, found.unit, faults)
        count = self.partner(line, row, column, ("n",), faults)
        spread = scaled(found.sd, factor)
        if spread and self.choices.scatter == "se":
            spread = self.from_error(spread, count, line, column, faults)
        spread = spread or self.scatter(line, row, column, count, faults)
        value = scaled(found.value, factor)
        spread = spread or self.relative(line, row, column, value, faults)
        value = f"{value}..{scaled(found.upper, factor)}" if found.upper else found.limit + value
        return value, spread, count, self.cell_unit(column)

    def scatter(self, line: int, row: Sequence[str], column: Column, count: str, faults: list[str]) -> str:
        """Standard deviation of single repeats from a column of its own."""
        spread = self.partner(line, row, column, ("sd",), faults)
        error = "" if spread else self.partner(line, row, column, ("se",), faults)
        return self.from_error(error, count, line, column, faults) if error else spread

    def relative(self, line: int, row: Sequence[str], column: Column, value: str, faults: list[str]) -> str:
        """Standard deviation of single repeats from their coefficient of variation."""
        for other in self.columns:
            if other.role == "cv" and other.of == column.place:
                found = self.single(line, row, other, faults)
                if found is not None and found.value:
                    share = SHARES.get(found.unit or other.heading.unit, 0.01)
                    return f"{share * float(found.value) * abs(float(value)):.6g}"
        return ""

    def from_error(self, error: str, count: str, line: int, column: Column, faults: list[str]) -> str:
        """Standard deviation of single repeats from the standard error of their mean."""
        if not count:
            faults.append(f"{self.where(line, column)}: a standard error needs the number of repeats, n")
            return ""
        return f"{float(error) * sqrt(float(count)):.6g}"

    def partner(
        self, line: int, row: Sequence[str], column: Column, roles: tuple[str, ...], faults: list[str]
    ) -> str:
        """Number of the column that belongs to an observable, in its unit; empty where there is none."""
        for other in self.columns:
            if other.role in roles and other.of in (column.place, -1):
                found = self.single(line, row, other, faults)
                if found is None or not found.value:
                    return ""
                return (
                    found.value if other.role == "n" else self.in_unit_of(line, found, other, column, faults)
                )
        return ""

    def in_unit_of(
        self, line: int, found: CellNumber, other: Column, column: Column, faults: list[str]
    ) -> str:
        """A scatter in the unit of its observable."""
        written, unit = found.unit or other.heading.unit, self.cell_unit(column)
        if written == "%" and unit != "%":
            faults.append(
                f"{self.where(line, other)}: a scatter in percent; give it in {unit or 'its unit'}, or head "
                "it 'CV [%]' where it is a share of the value"
            )
            return ""
        return scaled(found.value, self.factor(line, column, written, faults))

    def group(self, row: Sequence[str]) -> str:
        """Set-up of a row: the columns that name samples; empty where each row has its own."""
        named = [column for column in self.columns if column.role == "group"]
        distinct = {tuple(other[c.place] for c in named) for _, other in self.cells.lines}
        if len(distinct) == len(self.cells.lines):
            return ""
        return ", ".join(row[column.place] for column in named if row[column.place])

    def source(self, line: int, row: Sequence[str]) -> str:
        """Source of a row, else its place in the file."""
        named = [row[column.place] for column in self.columns if column.role == "source"]
        return ", ".join(filter(None, named)) or f"{self.cells.file}, row {line}"


def scaled(number: str, factor: float) -> str:
    """A number in another unit; as it stands where the unit stays."""
    return number if factor == 1.0 or not number else f"{float(number) * factor:.12g}"


def shown(text: str) -> str:
    """A cell in quotes, shortened."""
    clean = "".join(sign if sign.isprintable() else "?" for sign in text[: SHOWN + 1])
    return f"'{clean}'" if len(clean) <= SHOWN else f"'{clean[: SHOWN - 3]}...'"
