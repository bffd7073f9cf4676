"""Tables of measurements: a tidy CSV, one row for every mean of repeats, and the rows that a study uses.

Columns: observable, value, sd, n, unit, group, source, and one for every condition. A condition's unit may
stand in its heading, `slope [rad]`: its numbers are converted to the unit of the place that it sets, in a
scene that of the entry, in a model function SI. Without one they are in that unit already. `value` is the
mean of `n` repeats and `sd` the standard deviation of single repeats. An empty value, `no transport` or `<x`
is censored: the instrument saw nothing, or less than x. Rows that repeat observable, group, source and
conditions are repeats of one another.
"""

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from math import isfinite, nan
from pathlib import Path

import numpy as np

from taichi_erosion.campaign.study_file import ObservableEntry, StudyFile
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import Measurements
from taichi_erosion.scene.load import file_text
from taichi_erosion.scene.schema.units import (
    EXAMPLES,
    PURE,
    Scale,
    Unit,
    UnknownUnit,
    conversion,
    parse_scale,
    parse_unit,
    scale_between,
)

REQUIRED = ("observable", "value", "unit")
OPTIONAL = ("sd", "n", "group", "source")
REMARKS = ("note", "notes", "comment", "remark", "remarks", "replicate", "repeat", "date")
CENSORED = ("", "no transport")  # values of a censored row
HEADING = re.compile(r"(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?")
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,59}")
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?")
MOST_REPEATS = 10**9
LONGEST_SHOWN = 40  # characters of a cell that a message repeats


@dataclass(frozen=True)
class Row:
    """One row of a table; NaN where a number was left out."""

    line: int  # in the file, the heading being row 1
    observable: str
    value: float  # mean, or the limit below which a censored value lies; NaN: the study's floor
    censored: bool
    sd: float  # of single repeats
    n: int | None
    unit: str
    group: str
    source: str
    conditions: tuple[float, ...]  # as written, in the order of the table's conditions


@dataclass(frozen=True)
class Table:
    """A measurement file as read: `conditions` names the columns behind every row's conditions."""

    file: str
    conditions: tuple[str, ...]
    units: tuple[str | None, ...]  # of the conditions, as their headings have them; None: none is stated
    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Column:
    """Place, name and unit of a column."""

    place: int
    name: str
    unit: str | None = None


def read_table(path: Path, file: str = "") -> Table:
    """Measurements of one CSV file; raises BadInput with file, row, column, value."""
    name = (file or str(path)).replace("\n", "?")
    lines = list(csv_lines(file_text(path, name), name))
    if not lines:
        raise BadInput(f"{name}: is empty; the first row names the columns: {', '.join(REQUIRED)}, ...")
    columns = read_heading(lines[0][1], name)
    fixed = {column.name: column.place for column in columns if column.name in REQUIRED + OPTIONAL}
    conditions = condition_columns(columns, lines[1:], name)
    rows = [read_row(cells, fixed, conditions, f"{name}: row {line}", line) for line, cells in lines[1:]]
    if not rows:
        raise BadInput(f"{name}: has a heading but no measurement")
    refuse_copies(lines[1:], columns, name)
    names, units = tuple(c.name for c in conditions), tuple(c.unit for c in conditions)
    return Table(name, names, units, tuple(rows))


def csv_lines(text: str, name: str) -> Iterator[tuple[int, list[str]]]:
    """(row number, cells) of every line that is not empty; all as wide as the heading."""
    width = 0
    try:
        reader = csv.reader(io.StringIO(text.removeprefix("\ufeff"), newline=""), strict=True)
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            width = width or len(cells)
            if width == 1:
                refuse_separator(cells[0], name)
            if len(cells) != width:
                raise BadInput(f"{name}: row {reader.line_num} has {len(cells)} cells, the heading {width}")
            yield reader.line_num, [cell.strip() for cell in cells]
    except csv.Error as error:
        raise BadInput(f"{name}: not a CSV table: {error}") from None


def refuse_separator(heading: str, name: str) -> None:
    """Refuse a table of one column whose heading looks like several."""
    if ";" in heading or "\t" in heading:
        raise BadInput(
            f"{name}: heading {quoted(heading)} is one column; separate columns by commas, "
            "write decimals with a point"
        )


def read_heading(cells: Sequence[str], name: str) -> list[Column]:
    """Columns in their order."""
    columns: list[Column] = []
    for place, cell in enumerate(cells):
        match = HEADING.fullmatch(cell)
        if match is None or not NAME.fullmatch(match["name"]):
            raise BadInput(f"{name}: heading {quoted(cell)} is not a name of letters, digits and _")
        if match["name"] in [column.name for column in columns]:
            raise BadInput(f"{name}: column '{match['name']}' stands in the heading twice")
        columns.append(Column(place, match["name"], heading_unit(match, name)))
    for wanted in (*REQUIRED, *OPTIONAL):
        refuse_misspelt(wanted, [column.name for column in columns], name)
    return columns


def heading_unit(match: re.Match[str], name: str) -> str | None:
    """Unit in a heading, once it is known to be one; None where there is none."""
    if match["unit"] is None:
        return None
    if match["name"] in REQUIRED + OPTIONAL:
        raise BadInput(f"{name}: heading {quoted(match[0])}: the unit of values stands in column 'unit'")
    try:
        parse_scale(match["unit"])
    except UnknownUnit as error:
        told = error.hint or f"allowed: {EXAMPLES}"
        raise BadInput(f"{name}: heading {quoted(match[0])}: unknown unit; {told}") from None
    return match["unit"].strip()


def refuse_misspelt(wanted: str, names: Sequence[str], name: str) -> None:
    """Refuse a table where a column of the format is missing, or seems to be there under another spelling."""
    if wanted in names:
        return
    near = get_close_matches(wanted, [n for n in names if n not in REQUIRED + OPTIONAL], n=1, cutoff=0.75)
    if near:
        raise BadInput(f"{name}: column '{near[0]}' is unknown; did you mean '{wanted}'?")
    if wanted in REQUIRED:
        raise BadInput(f"{name}: column '{wanted}' is missing; there are: {', '.join(names)}")


def condition_columns(
    columns: Sequence[Column], lines: Sequence[tuple[int, Sequence[str]]], name: str
) -> list[Column]:
    """Columns of numbers that are neither of the format nor remarks."""
    found = [column for column in columns if column.name not in REQUIRED + OPTIONAL + REMARKS]
    for column in found:
        for line, cells in lines:
            if cells[column.place] and not NUMBER.fullmatch(cells[column.place]):
                raise BadInput(
                    f"{name}: row {line}, {column.name} = {quoted(cells[column.place])} must be a number: "
                    f"any other column is a condition; words belong into 'source' or 'note'"
                )
    return found


def read_row(
    cells: Sequence[str], fixed: Mapping[str, int], conditions: Sequence[Column], where: str, line: int
) -> Row:
    """One row, every cell checked."""

    def cell(column: str) -> str:
        return cells[fixed[column]] if column in fixed else ""

    if not NAME.fullmatch(cell("observable")):
        raise BadInput(f"{where}, observable = {quoted(cell('observable'))} must be a name")
    value, censored = read_value(cell("value"), where)
    return Row(
        line=line,
        observable=cell("observable"),
        value=value,
        censored=censored,
        sd=read_sd(cell("sd"), where),
        n=read_count(cell("n"), where),
        unit=read_unit(cell("unit"), where),
        group=cell("group"),
        source=cell("source"),
        conditions=tuple(number(cells[column.place], f"{where}, {column.name}") for column in conditions),
    )


def read_value(text: str, where: str) -> tuple[float, bool]:
    """Value and whether it is censored; NaN where no limit is stated."""
    if text.lower() in CENSORED:
        return nan, True
    limit = text.removeprefix("<").strip()
    if not NUMBER.fullmatch(limit):
        raise BadInput(
            f"{where}, value = {quoted(text)} must be a number, '<' and a number, or empty for 'no transport'"
        )
    return number(limit, f"{where}, value"), text.startswith("<")


def read_sd(text: str, where: str) -> float:
    """Standard deviation of single repeats, NaN where none is given."""
    sd = number(text, f"{where}, sd")
    if sd <= 0.0:
        raise BadInput(f"{where}, sd = {quoted(text)} must be above 0; leave it empty where it is not known")
    return sd


def read_count(text: str, where: str) -> int | None:
    """Number of repeats, None where none is given."""
    if not text:
        return None
    count = number(text, f"{where}, n")
    if count != int(count) or not 1 <= count <= MOST_REPEATS:
        raise BadInput(f"{where}, n = {quoted(text)} must be a whole number from 1 to {MOST_REPEATS:g}")
    return int(count)


def read_unit(text: str, where: str) -> str:
    """Unit as it stands, once it is known to be one."""
    try:
        parse_unit(text)
    except UnknownUnit as error:
        told = error.hint or f"allowed: {EXAMPLES}"
        raise BadInput(f"{where}, unit = {quoted(text)} is not known; {told}") from None
    return text or "1"


def number(text: str, where: str) -> float:
    """A finite number, NaN for an empty cell."""
    if not text:
        return nan
    value = float(text) if NUMBER.fullmatch(text) else nan
    if not isfinite(value):
        raise BadInput(f"{where} = {quoted(text)} must be a finite number")
    return value


def quoted(text: str) -> str:
    """A cell on one line, shortened."""
    clean = "".join(c if c.isprintable() else "?" for c in text[: LONGEST_SHOWN + 1])
    return f"'{clean}'" if len(clean) <= LONGEST_SHOWN else f"'{clean[: LONGEST_SHOWN - 3]}...'"


def refuse_copies(lines: Sequence[tuple[int, Sequence[str]]], columns: Sequence[Column], name: str) -> None:
    """Refuse a row that stands twice; equal single values may be two repeats, equal means with sd may not."""
    places = {column.name: column.place for column in columns}
    telling = [places[c] for c in ("sd", "replicate", "repeat") if c in places]
    seen: dict[tuple[str, ...], int] = {}
    for line, cells in lines:
        first = seen.setdefault(tuple(cells), line)
        if first != line and any(cells[place] for place in telling):
            raise BadInput(f"{name}: row {line} repeats row {first} cell by cell; remove one of them")


def study_measurements(
    table: Table, file: StudyFile, name: str, places: Mapping[str, str] | None = None
) -> tuple[Measurements, list[str]]:
    """Rows that the study uses, in the units of use, and sentences about the others.

    `places` gives the unit of what a condition sets; of the conditions that it leaves out it is SI.
    """
    refuse_absent(table, file, name)
    rows = [row for row in table.rows if row.observable in file.observables]
    scales = condition_scales(table, file, places or {})
    units = {name: model_unit(name, entry, rows, table.file) for name, entry in file.observables.items()}
    factors = [unit_factor(row, units[row.observable], table.file) for row in rows]
    limits = [
        censoring_limit(row, s, file.observables[row.observable], table.file)
        for row, s in zip(rows, factors, strict=True)
    ]
    used = [used_conditions(row, table, scales) for row in rows]
    measurements = Measurements(
        observable=tuple(row.observable for row in rows),
        value=np.array([nan if r.censored else s * r.value for r, s in zip(rows, factors, strict=True)]),
        sd=np.array([s * row.sd for row, s in zip(rows, factors, strict=True)]),
        n=np.array([nan if row.n is None else float(row.n) for row in rows]),
        group=tuple(group_of(row, at) for row, at in zip(rows, used, strict=True)),
        unit=tuple(units[row.observable] for row in rows),
        conditions={column: np.array([at[column] for at in used]) for column in file.conditions},
        censored=np.array([row.censored for row in rows], dtype=np.bool_),
        limit=np.array(limits),
        source=tuple(row.source for row in rows),
        scales=scales,
    )
    return measurements, [*unused_notes(table, file), *ignored_notes(table, file)]


def refuse_absent(table: Table, file: StudyFile, name: str) -> None:
    """Refuse a study that names conditions or observables which the table has not."""
    for column in file.conditions:
        if column not in table.conditions:
            there = ", ".join(table.conditions) or "none"
            raise BadInput(
                f"{name}: conditions.{column} is no column of {table.file}; conditions there: {there}"
            )
    measured = dict.fromkeys(row.observable for row in table.rows)
    for observable in file.observables:
        if observable not in measured:
            there = ", ".join(measured)
            raise BadInput(f"{name}: observables.{observable} has no row in {table.file}; there: {there}")


def condition_scales(table: Table, file: StudyFile, places: Mapping[str, str]) -> dict[str, Scale]:
    """Scale of every condition of a study; raises BadInput where a unit does not fit."""
    return {column: column_scale(table, column, places.get(column)) for column in file.conditions}


def column_scale(table: Table, column: str, place: str | None) -> Scale:
    """Scale of a condition from its unit in the table to that of the place it sets; None: SI."""
    written = table.units[table.conditions.index(column)]
    if written is None:
        return Scale(place or "")
    target = Unit(1.0, parse_scale(written).kind) if place is None else place_unit(place, column, table.file)
    scale = scale_between(written, target)
    if scale is None:
        told = f"it sets a number in {place}" if place != "1" else "it sets a pure number"
        raise BadInput(f"{table.file}: heading '{column} [{written}]': {told}; give it in that unit")
    return scale


def place_unit(place: str, column: str, file: str) -> Unit:
    """Unit of a place; raises BadInput for one that a column of numbers cannot set."""
    try:
        return PURE if place == "1" else parse_unit(place)
    except UnknownUnit:
        raise BadInput(f"{file}: column '{column}' sets what is counted in {place}, not a number") from None


def used_conditions(row: Row, table: Table, scales: Mapping[str, Scale]) -> dict[str, float]:
    """Conditions of a row by name, in the units of use."""
    stated = dict(zip(table.conditions, row.conditions, strict=True))
    return {name: scale.used(stated[name]) for name, scale in scales.items()}


def group_of(row: Row, at: Mapping[str, float]) -> str:
    """Physical set-up of a row; its conditions where none is named."""
    return row.group or ", ".join(f"{value:g}" for value in at.values()) or "all"


def model_unit(name: str, entry: ObservableEntry, rows: Sequence[Row], file: str) -> str:
    """Unit of a model's values: that of the study, else the unit of the first row."""
    unit = entry.unit if entry.unit is not None else next(row.unit for row in rows if row.observable == name)
    try:
        parse_unit(unit)
    except UnknownUnit:
        raise BadInput(
            f"{file}: observables.{name}.unit = '{unit}' is not known; allowed: {EXAMPLES}"
        ) from None
    return unit


def unit_factor(row: Row, unit: str, file: str) -> float:
    """Factor from a row's unit to the model's."""
    factor = conversion(parse_unit(row.unit), parse_unit(unit))
    if factor is None:
        raise BadInput(f"{file}: row {row.line}, unit = '{row.unit}': {row.observable} is counted in {unit}")
    return factor


def censoring_limit(row: Row, factor: float, entry: ObservableEntry, file: str) -> float:
    """Upper limit of a censored value in the model's unit; NaN for an ordinary value."""
    if not row.censored:
        if entry.transform != "identity" and row.value <= 0.0 and not entry.floor:
            raise BadInput(
                f"{file}: row {row.line}, value = {row.value:g} must be above 0 for transform = "
                f"'{entry.transform}'; write '<' and the least value that is seen"
            )
        return nan
    if isfinite(row.value):
        return factor * row.value
    if entry.floor:
        return entry.floor
    raise BadInput(
        f"{file}: row {row.line}, value is empty: write '<' and the least value that is seen, or give "
        f"observables.{row.observable}.floor in the study"
    )


def unused_notes(table: Table, file: StudyFile) -> list[str]:
    """Observables of the table that the study does not name."""
    other = [row.observable for row in table.rows if row.observable not in file.observables]
    return [
        f"{name}: {other.count(name)} rows of {table.file} are not used; the study names no such observable."
        for name in dict.fromkeys(other)
    ]


def ignored_notes(table: Table, file: StudyFile) -> list[str]:
    """Conditions that vary in the table and do not enter the model."""
    rows = [row for row in table.rows if row.observable in file.observables]
    notes = []
    for place, column in enumerate(table.conditions):
        values = {row.conditions[place] for row in rows if isfinite(row.conditions[place])}
        if column not in file.conditions and len(values) > 1:
            notes.append(
                f"{column} varies in {table.file}, but is not under [conditions]: the model is not told."
            )
    return notes
