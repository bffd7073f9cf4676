"""The tidy form of a table of measurements: one row for every mean of repeats.

Columns: observable, value, sd, n, unit, group, source, vault, and one for every condition. A condition's unit
may stand in its heading, `slope [rad]`: its numbers are converted to the unit of the place that it sets, in a
scene that of the entry, in a model function SI. Without one they are in that unit already. `value` is the
mean of `n` repeats and `sd` the standard deviation of single repeats. A censored value is one of which only
limits are known: `<x`, and `no transport` or an empty cell where the instrument saw nothing; `>x`; `20..25`
or `20 to 25`. Rows that repeat observable, group, source and conditions are repeats of one another;
`replicate` (or `repeat`) says which rows of several observables are of one heap. A column `sd of CONDITION`
is the standard deviation of the error with which a condition was measured, `sd of set CONDITION` that of the
true value about the one to which it was set; empty: it is exact. `vault` says whether a row was held out when
rows were drawn (`held_out_rows.py`).
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from math import inf, isfinite, nan
from typing import Any, TypeVar, get_args

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import Drawn
from taichi_erosion.evidence.data.tables.cell_numbers import likely_number, misprint, plain_cell
from taichi_erosion.evidence.data.tables.spreadsheet import Cells
from taichi_erosion.scene.schema.units import EXAMPLES, UnknownUnit, parse_scale, parse_unit

Found = TypeVar("Found")
REQUIRED = ("observable", "value", "unit")
OPTIONAL = ("sd", "n", "group", "source", "vault")
REPEATS = ("replicate", "repeat")  # columns that name the heap
REMARKS = ("note", "notes", "comment", "remark", "remarks", *REPEATS, "date")
CENSORED = ("", "no transport")  # values of a censored row
HEADING = re.compile(r"(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?")
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,59}")
SD_OF = re.compile(
    r"sd[ _]of[ _](?P<set>set )?(?P<name>[A-Za-z][A-Za-z0-9_]*)"
)  # of a column on a condition's error
COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d{1,3})?")
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?")
BETWEEN = r"\s*(?:\.\.\.?|…|to|bis)\s*"  # between the ends of an interval
INTERVAL = re.compile(rf"(?P<low>{NUMBER.pattern}){BETWEEN}(?P<high>{NUMBER.pattern})")
COMMA_INTERVAL = re.compile(rf"(?P<low>[+-]?\d*,?\d+){BETWEEN}(?P<high>[+-]?\d*,?\d+)")
SIDES = {"<": -inf, ">": inf}  # signs of limits with the reach of the value
MOST_REPEATS = 10**9
OF_NUMBERS = "any other column is a condition; words belong into 'source' or 'note'"
LONGEST_SHOWN = 40  # characters of a cell that a message repeats


@dataclass(frozen=True)
class Row:
    """One row of a table; NaN where a number was left out."""

    line: int  # in the file, the heading being row 1
    observable: str
    value: float  # mean, limit of a censored value, or middle of its interval; NaN: the study's floor
    censored: bool
    sd: float  # of single repeats
    n: int | None
    unit: str
    group: str
    source: str
    conditions: tuple[float, ...]  # as written, in the order of the table's conditions
    reach: float = (
        -inf
    )  # of a censored value: -inf below `value`, +inf above, h between value - h and value + h
    condition_sd: Mapping[str, float] = field(default_factory=dict)  # as written, of conditions that have one
    drawn: Drawn = ""
    repeat: str = ""  # name of the heap among those of its set-up and conditions


@dataclass(frozen=True)
class Table:
    """A measurement file as read: `conditions` names the columns behind every row's conditions."""

    file: str
    conditions: tuple[str, ...]
    units: tuple[str | None, ...]  # of the conditions, as their headings have them; None: none is stated
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()  # about rows that are left out
    set_conditions: tuple[str, ...] = ()  # of which the sd is that about the value to which they were set


@dataclass(frozen=True)
class Column:
    """Place, name and unit of a column."""

    place: int
    name: str
    unit: str | None = None
    error_of: str = ""  # condition of which its numbers are the standard deviation
    is_set: bool = False  # about the value to which it was set


def tidy_table(cells: Cells, faults: "Faults | None" = None) -> Table:
    """Rows of a tidy table, every cell checked; raises BadInput with all its faults.

    Where `faults` is given, those of cells are added to it in place of an error, and what is wrong is NaN.
    """
    name, collected = cells.file, faults is not None
    faults = Faults() if faults is None else faults
    if not cells.rows:
        raise BadInput(f"{name}: is empty; the first row names the columns: {', '.join(REQUIRED)}, ...")
    columns = read_heading(cells.heading, name)
    fixed = {column.name: column.place for column in columns if column.name in REQUIRED + OPTIONAL + REPEATS}
    lines = cells.lines
    conditions = condition_columns(columns, lines, name, faults)
    errors = [column for column in columns if column.error_of]
    rows = [read_row(line, row, fixed, conditions, name, faults) for line, row in lines]
    rows = [
        replace(each, condition_sd=read_errors(row, errors, f"{name}: row {line}", faults))
        for each, (line, row) in zip(rows, lines, strict=True)
    ]
    if not cells.lines and not faults:
        faults.append(f"{name}: has a heading but no measurement")
    faults.of(refuse_copies, lines, columns, name)
    if not collected:
        faults.tell()
    names, units = tuple(c.name for c in conditions), tuple(c.unit for c in conditions)
    as_set = tuple(column.error_of for column in errors if column.is_set)
    return Table(name, names, units, tuple(rows), set_conditions=as_set)


class Faults(list[str]):
    """Faults of a file, one line each, in the order in which they are found."""

    def of(self, reader: Callable[..., Found], *arguments: Any) -> Found | None:
        """Result of a reader; None where it refuses, which is one fault more."""
        try:
            return reader(*arguments)
        except BadInput as error:
            self.extend(error.faults)
            return None

    def tell(self) -> None:
        """Raise BadInput where there is a fault."""
        if self:
            raise BadInput(*dict.fromkeys(self))


def is_tidy(heading: Sequence[str]) -> bool:
    """Whether a heading is that of a tidy table: it has a column 'observable', if under another spelling."""
    names = [cell.partition("[")[0].strip().lower() for cell in heading]
    return bool(get_close_matches("observable", names, n=1, cutoff=0.85))


def pointed(cells: Cells) -> Cells:
    """Cells with decimal points in numbers that have commas."""
    if not cells.decimal_comma:
        return cells
    rows = [(line, tuple(map(pointed_cell, row))) for line, row in cells.lines]
    return replace(cells, rows=(cells.rows[0], *rows), decimal_comma=False)


def pointed_cell(cell: str) -> str:
    """A number with a decimal point; any other cell as it stands."""
    match = COMMA_INTERVAL.fullmatch(cell)
    if match is not None:
        return f"{pointed_cell(match['low'])}..{pointed_cell(match['high'])}"
    limit, number = (cell[0], cell[1:].strip()) if cell[:1] in SIDES else ("", cell)
    return limit + number.replace(",", ".") if COMMA_NUMBER.fullmatch(number) else cell


def read_heading(cells: Sequence[str], name: str) -> list[Column]:
    """Columns in their order; raises BadInput with all faults of the heading."""
    columns: list[Column] = []
    faults = Faults()
    for place, cell in enumerate(cells):
        match = HEADING.fullmatch(cell)
        error = SD_OF.fullmatch(match["name"]) if match is not None else None
        if match is None or not (error or NAME.fullmatch(match["name"])):
            faults.append(f"{name}: heading {quoted(cell)} is not a name of letters, digits and _")
            continue
        told = f"sd of {error['set'] or ''}{error['name']}" if error else match["name"]
        if told in [column.name for column in columns]:
            faults.append(f"{name}: column '{told}' stands in the heading twice")
        unit = faults.of(heading_unit, match, name)
        of, is_set = (error["name"], bool(error["set"])) if error else ("", False)
        columns.append(Column(place, told, unit, of, is_set))
    for wanted in (*REQUIRED, *OPTIONAL):
        faults.of(refuse_misspelt, wanted, [column.name for column in columns], name)
    faults += error_column_faults(columns, name)
    faults.tell()
    return columns


def error_column_faults(columns: Sequence[Column], name: str) -> Iterator[str]:
    """Columns `sd of CONDITION` without that condition, or in another unit."""
    units = {column.name: column.unit for column in columns if is_condition(column)}
    for column in columns:
        if column.error_of and column.error_of not in units:
            there = ", ".join(units) or "none"
            yield f"{name}: column '{column.name}': no column '{column.error_of}'; conditions there: {there}"
        elif column.error_of and column.unit not in (None, units[column.error_of]):
            stated = units[column.error_of]
            told = f"in [{stated}]: give it so" if stated else "without a unit: leave it out"
            yield f"{name}: column '{column.name}' is in [{column.unit}]; {column.error_of} is {told}"


def is_condition(column: Column) -> bool:
    """Whether a column holds a condition."""
    return not column.error_of and column.name not in REQUIRED + OPTIONAL + REMARKS


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
    columns: Sequence[Column], lines: Sequence[tuple[int, Sequence[str]]], name: str, faults: Faults
) -> list[Column]:
    """Columns of numbers that are neither of the format nor remarks."""
    found = [column for column in columns if is_condition(column)]
    for line, cells in lines:
        for column in columns:
            if not (is_condition(column) or column.error_of):
                continue
            if cells[column.place] and not NUMBER.fullmatch(cells[column.place]):
                likely = likely_number(plain_cell(cells[column.place]))
                told = f"must be a number: {OF_NUMBERS}" if likely is None else misprint(likely)
                faults.append(f"{name}: row {line}, {column.name} = {quoted(cells[column.place])} {told}")
    return found


def read_row(
    line: int,
    cells: Sequence[str],
    fixed: Mapping[str, int],
    conditions: Sequence[Column],
    name: str,
    faults: Faults,
) -> Row:
    """One row, every cell checked; what is wrong is NaN and a fault."""
    where = f"{name}: row {line}"

    def cell(column: str) -> str:
        return cells[fixed[column]] if column in fixed else ""

    def stated(column: Column) -> float:
        text = cells[column.place]
        found = faults.of(number, text, f"{where}, {column.name}") if NUMBER.fullmatch(text) else nan
        return nan if found is None else found

    if not NAME.fullmatch(cell("observable")):
        faults.append(f"{where}, observable = {quoted(cell('observable'))} must be a name")
    value, reach = faults.of(read_value, cell("value"), where) or (nan, 0.0)
    sd = faults.of(read_sd, cell("sd"), where)
    return Row(
        line=line,
        observable=cell("observable"),
        value=value,
        censored=reach != 0.0,
        sd=nan if sd is None else sd,
        n=faults.of(read_count, cell("n"), where),
        unit=faults.of(read_unit, cell("unit"), where) or "1",
        group=cell("group"),
        source=cell("source"),
        conditions=tuple(stated(column) for column in conditions),
        reach=reach,
        drawn=faults.of(read_drawn, cell("vault"), where) or "",
        repeat=cell("replicate") or cell("repeat"),
    )


def read_errors(
    cells: Sequence[str], columns: Sequence[Column], where: str, faults: Faults
) -> dict[str, float]:
    """Standard deviations of the conditions of a row, where they are given."""
    found = {}
    for column in columns:
        text = cells[column.place]
        value = faults.of(number, text, f"{where}, {column.name}") if NUMBER.fullmatch(text) else nan
        if value is not None and value < 0.0:
            faults.append(f"{where}, {column.name} = {quoted(text)} must not be below 0")
        elif value is not None and isfinite(value):
            found[column.error_of] = value
    return found


def read_drawn(text: str, where: str) -> Drawn:
    """What became of a row when rows were drawn for the vault."""
    for known in get_args(Drawn):
        if text == known:
            return known
    raise BadInput(f"{where}, vault = {quoted(text)} must be 'held out', 'fitted' or empty")


def read_value(text: str, where: str) -> tuple[float, float]:
    """Value, and its reach (`Row.reach`), 0 where it is not censored; NaN where no limit is stated."""
    if text.lower() in CENSORED:
        return nan, -inf
    match = INTERVAL.fullmatch(text)
    if match is not None:
        low, high = (number(match[end], f"{where}, value") for end in ("low", "high"))
        if not low < high:
            raise BadInput(f"{where}, value = {quoted(text)}: the first number must be below the second")
        return 0.5 * (low + high), 0.5 * (high - low)
    limit = text.lstrip("<>").strip() if text[:1] in SIDES else text
    likely = None if NUMBER.fullmatch(limit) else likely_number(plain_cell(text))
    if likely is not None:
        raise BadInput(f"{where}, value = {quoted(text)} {misprint(likely)}")
    if not NUMBER.fullmatch(limit):
        allowed = "a number, '<' or '>' and a number, '20..25', or empty for 'no transport'"
        raise BadInput(f"{where}, value = {quoted(text)} must be {allowed}")
    return number(limit, f"{where}, value"), SIDES.get(text[:1], 0.0)


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
    telling = [places[c] for c in ("sd", *REPEATS) if c in places]
    seen: dict[tuple[str, ...], int] = {}
    for line, cells in lines:
        first = seen.setdefault(tuple(cells), line)
        if first != line and any(cells[place] for place in telling):
            raise BadInput(f"{name}: row {line} repeats row {first} cell by cell; remove one of them")
