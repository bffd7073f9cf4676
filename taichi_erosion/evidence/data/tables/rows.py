"""Rows of a table of measurements: what each of them says, and what was understood of its columns.

A tidy table has the columns observable, value, unit, and where it likes sd, n, group, source, vault,
replicate; any other column of numbers is a condition, with its unit in its heading (`slope [rad]`; without
one it is in that of the place which it sets, for a model function SI), and `sd of CONDITION` the standard
deviation of the error with which it was measured, `sd of set CONDITION` that of the true value about the one
to which it was set. In a laboratory's own table the columns are what `interview.py` understood of them.

`value` is the mean of `n` repeats and `sd` the standard deviation of single repeats. A censored value is one
of which only limits are known: `<x`, and `no transport` (in a tidy table an empty cell too) where the
instrument saw nothing; `>x`; `20..25` or `20 to 25`. Rows that repeat observable, group, source and
conditions are repeats of one another; `replicate` says which rows of several observables are of one heap.
`vault` says whether a row was held out when rows were drawn (`held_out_rows.py`).
"""

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from math import inf, isfinite, isnan, nan, sqrt
from typing import Any, TypeVar, get_args

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import Drawn
from taichi_erosion.evidence.data.tables.column_roles import LOWEST_WIND, SHARES, UNUSED, Column, TableOptions
from taichi_erosion.measures.boundary_layer import friction_velocity_ratio
from taichi_erosion.scene.schema.units import (
    EXAMPLES,
    Scale,
    UnknownUnit,
    parse_scale,
    parse_unit,
    scale_between,
)
from taichi_erosion.tables.cell_numbers import (
    CellFault,
    CellNumber,
    cell_word,
    is_missing,
    is_quantity,
    read_cell,
    reason,
)
from taichi_erosion.tables.headings import Role, has_word, known_words, meaning_of, read_heading
from taichi_erosion.tables.number_columns import own_name
from taichi_erosion.tables.spreadsheet import LEFT_OUT, Cells, word_of_summary_row

Found = TypeVar("Found")
REQUIRED = ("observable", "value", "unit")
ROLES: dict[str, Role] = {  # of the columns of a tidy table
    **{"observable": "observable", "value": "value", "unit": "unit", "sd": "sd", "n": "n", "group": "group"},
    **{"source": "source", "vault": "vault", "replicate": "repeat", "repeat": "repeat", "date": "remark"},
    **dict.fromkeys(("note", "notes", "comment", "remark", "remarks"), "remark"),
}
NAME = re.compile(r"[^\W\d_]\w{0,59}")
SD_OF = re.compile(r"sd[ _]of[ _](?P<set>set )?(?P<name>.+)")
PLACE = re.compile(r"(?P<file>.*), row (?P<line>\d+)")  # source of a row that names no other
ERROR_OF_MEAN = r"(?:std\.? err(?:or)?|standard ?(?:errors?|fehler)|erreur[- ]type|error est[aá]ndar"
ERROR_OF_MEAN += r"|erro padr[aã]o|标准误差?|標準誤差|стандартная ошибка)(?!\w)"
STANDARD_ERROR = re.compile(rf"(?i)(?:±|\+/-|\+-)\s*1?\s*(?:s\.?\s?e\.?(?:\s?m\.?)?(?!\w)|{ERROR_OF_MEAN})")
MOST_REPEATS = 10**9
MOST_SCATTER = 10.0  # sd of a measurement over its value
SHOWN = 40  # characters of a cell that a message repeats
SOLO_ROWS = 3  # with one fault, up to which each is told
MOST_LISTED = 6  # numbers of rows in a sentence


class Faults(list[str]):
    """Faults of a file, one line each, in the order in which they are found."""

    def of(self, reader: Callable[..., Found], *arguments: Any) -> Found | None:
        """Result of a reader; None where it refuses, which is one fault more."""
        try:
            return reader(*arguments)
        except BadInput as error:
            self.extend(error.faults)
            return None

    def raise_if_any(self) -> None:
        if self:
            raise BadInput(*dict.fromkeys(self))


@dataclass(frozen=True)
class Row:
    """One row of a table; NaN where a number was left out."""

    line: int  # in the file, from 1
    observable: str
    value: float  # mean, limit of a censored value, or middle of its interval; NaN: the study's floor
    censored: bool
    sd: float  # of single repeats
    n: int | None
    unit: str
    group: str
    source: str
    conditions: tuple[float, ...]  # as written, in the order of the table's conditions
    reach: float = -inf  # of a censored value: -inf below `value`, +inf above, h between value - h, value + h
    condition_sd: dict[str, float] = field(default_factory=dict)  # as written, of conditions that have one
    draw: Drawn = ""
    repeat: str = ""  # name of the heap among those of its set-up and conditions


@dataclass(frozen=True)
class Table:
    file: str
    conditions: tuple[str, ...]  # names of the columns behind every row's conditions
    units: tuple[str | None, ...]  # of the conditions, as their headings have them; None: none is stated
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()  # what was assumed
    set_conditions: tuple[str, ...] = ()  # of which the sd is that about the value to which they were set
    form: str = ""  # how the file was read, in words
    columns: tuple[Column, ...] = ()  # what was understood of each


def tidy_columns(cells: Cells) -> list[Column]:
    """Columns of a tidy table; raises BadInput with all faults of its heading."""
    columns, faults, file = list[Column](), Faults(), cells.file
    for place, text in enumerate(cells.heading):
        heading, where = read_heading(text), f"{file}: heading {quote_cell(text)}"
        error = SD_OF.fullmatch(heading.name)
        name = error["name"] if error else heading.name
        name = meaning_of(name)[1].rpartition(".")[2] if heading.law else name  # its numbers are turned
        name = name if NAME.fullmatch(name) else own_name(name, REQUIRED, place)
        role = ROLES.get(re.sub("^note_.*", "note", name.lower()), "condition")
        role = "condition_sd" if error else role
        words = [row[place] for _, row in cells.lines if row[place]] if role == "condition" else []
        if words and not heading.unit and not any(map(is_quantity, words)):
            role = "remark"
            if 1 < len({*words}) < len(words) and meaning_of(heading.name)[0] != "remark":
                faults.append(
                    f"{where}: its words recur: call it 'group' if they name set-ups, else 'note ...'"
                )
        if heading.unreadable:
            faults.append(f"{where}: unknown unit; allowed: {EXAMPLES}")
        elif meaning_of(name)[0] in ("se", "cv", "spread"):
            faults.append(f"{where}: write the sd of single repeats, in a column 'sd'; SE is sd / n^1/2")
        elif heading.unit and role not in ("condition", "condition_sd", "remark"):
            faults.append(f"{where}: the unit of values stands in column 'unit'")
        if any((name, role) == (each.title, each.role) for each in columns):
            faults.append(f"{file}: column '{heading.name}' stands in the heading twice")
        columns.append(Column(place, heading, role, name, name, is_set=bool(error and error["set"])))
    faults += missing_column_faults([each.heading.name for each in columns], file)
    units = {each.title: each.heading.unit for each in columns if each.role == "condition"}
    faults += error_column_faults([each for each in columns if each.role == "condition_sd"], units, file)
    faults.raise_if_any()
    return columns


def row_faults(cells: Cells) -> Iterator[str]:
    """Rows of words alone, which may name those below them, and marks by which a footnote excludes rows."""
    labels = [(line, *filter(None, row)) for line, row in cells.lines if sum(map(bool, row)) == 1]
    for line, cell in labels:
        if not (is_missing(cell) or is_quantity(cell)):
            remedy = "write it in each row below, in a column 'set-up', or delete the row"
            yield f"{cells.file}: row {line}, '{cell}', has words alone: {remedy}"
    starred = [part for part in re.split(r"[.;]", cells.titles) if re.search(r"[*†‡§]", part)]
    excluded = any(has_word(part, known_words()["rows"]["excluded"]) for part in starred)
    if excluded and any(LEFT_OUT in note for note in cells.notes):
        yield f"{cells.file}: words beside the table exclude rows that are marked: delete these rows"


def missing_column_faults(names: Sequence[str], file: str) -> Iterator[str]:
    """Columns of a tidy table that are missing, or seem to be there under another spelling."""
    expected = (*REQUIRED, "sd", "n", "group", "source", "vault")
    others = [name for name in names if name not in ROLES]
    for each in (name for name in expected if name not in names):
        if near := get_close_matches(each, others, n=1, cutoff=0.75):
            yield f"{file}: column '{near[0]}' is unknown; did you mean '{each}'?"
        elif each in REQUIRED:
            yield f"{file}: column '{each}' is missing; there are: {', '.join(names)}"


def error_column_faults(errors: Sequence[Column], units: dict[str, str], file: str) -> Iterator[str]:
    """Columns `sd of CONDITION` without that condition, or in another unit."""
    for column in errors:
        where, unit = f"{file}: column '{column.heading.name}'", column.heading.unit
        if column.title not in units:
            there = ", ".join(units) or "none"
            yield f"{where}: no column '{column.title}'; conditions there: {there}"
        elif unit not in ("", kind := units[column.title]):
            yield f"{where} is in [{unit}]; {column.title} is in [{kind}]: give it so"


def table_from_cells(
    cells: Cells, columns: Sequence[Column], faults: list[str], options: TableOptions | None = None
) -> Table:
    """Rows of a table with known columns; all faults of its cells are added to `faults`.

    Where `options` want it complete, every row states the conditions and the set-up that others state.
    """
    reader = RowReader(cells, columns, faults)
    rows = [row for line, row in cells.lines for row in reader.rows_of_line(line, row)]
    words = [each for each in reader.columns_with("remark") if reader.tidy and each.title not in ROLES]
    notes = [f"not used: '{each.heading.text}'" for each in words]
    if reader.exact:
        notes.append(f"a scatter of 0 counts as not stated, in {row_list_text(reader.exact)}")
    faults += reader.cell_faults()
    if options is not None and options.complete:
        rows = drop_rows_lacking_conditions(reader, rows, options.titles.values(), notes)
    if not rows and not faults:
        faults.append(f"{cells.file}: no measured value; commas, semicolons or tabs separate columns")
    conditions = reader.columns_with("condition")
    names, units = tuple(each.title for each in conditions), tuple(c.heading.unit or None for c in conditions)
    set_names = {each.title for each in reader.columns_with("condition_sd") if each.is_set} | reader.classes
    rest = tuple(notes), tuple(sorted(set_names)), cells.form, tuple(columns)
    return Table(cells.file, names, units, tuple(rows), *rest)


def drop_rows_lacking_conditions(
    reader: "RowReader", rows: Sequence[Row], names: Collection[str], notes: list[str]
) -> list[Row]:
    """The rows without those of which a condition is not known (`-`), which is told.

    A blank cell of a condition, or of a set-up in a laboratory's own table, is a fault: one of a condition
    where another row of the same observable states it. `names`: of the conditions in use; empty: all.
    """
    lost = set[int]()
    for column in reader.columns_with("condition", *(() if reader.tidy else ("group",))):
        cells = {line: row[column.place] for line, row in reader.cells.lines}
        with_cell = {row.observable for row in rows if not is_missing(cells[row.line])}
        blanks = {row.line: cells[row.line] for row in rows if row.observable in with_cell}
        bare = {line: cell for line, cell in blanks.items() if is_missing(cell)}
        where = f"column '{column.heading.text}'"
        if column.role == "condition" and names and column.title not in names:
            continue
        if blank := [line for line, cell in bare.items() if not cell]:
            reader.faults.append(
                f"{reader.cells.file}: {where} is blank in {row_list_text(blank)}, and other rows state it; "
                "write 0 where there is none, '-' where it is not known (the row is not used), or fill these "
                f"cells (--fill-down: a blank cell repeats the one above it); {UNUSED}"
            )
        elif bare and column.role == "condition":
            notes.append(f"{where} is not known in {row_list_text([*bare])}: not used")
            lost |= bare.keys()
    return [row for row in rows if row.line not in lost]


def row_list_text(lines: Sequence[int]) -> str:
    """`3 rows (4, 5, 7)` of a file; of many the first."""
    first = ", ".join(map(str, lines[:MOST_LISTED])) + (", ..." if len(lines) > MOST_LISTED else "")
    return f"row {first}" if len(lines) == 1 else f"{len(lines)} rows ({first})"


@dataclass(frozen=True)
class RowReader:
    cells: Cells
    columns: Sequence[Column]
    faults: list[str]
    wrong: dict[tuple[int, str], list[str]] = field(default_factory=dict)  # cells by column and reason
    classes: set[str] = field(default_factory=set)  # conditions of which ranges are stated
    exact: list[int] = field(default_factory=list)  # lines with a scatter of 0

    @property
    def tidy(self) -> bool:
        """Whether the measured quantity stands in a column of its own."""
        return any(column.role == "value" for column in self.columns)

    def columns_with(self, *roles: Role) -> list[Column]:
        return [column for column in self.columns if column.role in roles]

    def add_fault(self, line: int, column: Column, row: Sequence[str], words: object) -> None:
        cell = quote_cell(row[column.place])
        message = f"{self.cells.file}: row {line}, {column.heading.text} = {cell} {words}"
        self.wrong.setdefault((column.place, str(words)), []).append(message)

    def cell_faults(self) -> Iterator[str]:
        """What is wrong with cells; of many with one reason the first and the number of the others."""
        for messages in self.wrong.values():
            alone = len(messages) <= SOLO_ROWS
            yield from messages if alone else [f"{messages[0]}; {len(messages) - 1} rows more"]

    def rows_of_line(self, line: int, row: Sequence[str]) -> Iterator[Row]:
        """What one row of the file says: in a laboratory's own table a row for each measured quantity."""
        places = [column.place for column in self.columns_with("condition")]
        if not self.tidy and (summary := word_of_summary_row(self.cells, row, places)):
            message = "the row sums up others, is a statistic or is excluded: remove it"
            self.faults.append(f"{self.cells.file}: row {line}, '{summary}': {message}")
            return
        numbers = [(each.title, self.read_number(line, row, each)) for each in self.columns_with("condition")]
        classes = {name: number.reach / sqrt(3.0) for name, number in numbers if 0.0 < number.reach < inf}
        self.classes.update(classes)  # anywhere in which the grains may lie
        errors = {name: number.sd for name, number in numbers} | classes  # sd behind ±
        errors |= {c.title: self.read_positive(line, row, c) for c in self.columns_with("condition_sd")}
        # a row of a laboratory's table that names no source has its place in the file
        source = self.text(row, "source") or ("" if self.tidy else f"{self.cells.file}, row {line}")
        shared = Row(
            *(line, "", nan, False, nan, None, "", self.text(row, "group"), source),
            conditions=tuple(number.value for _, number in numbers),
            condition_sd={name: sd for name, sd in errors.items() if isfinite(sd)},
            draw=self.read_vault_draw(line, row),
            repeat=self.text(row, "repeat"),
        )
        for column in self.columns_with("value" if self.tidy else "observable"):
            reading = self.read_measurement(line, row, column, shared)
            if reading is not None:
                yield reading

    def read_measurement(self, line: int, row: Sequence[str], column: Column, shared: Row) -> Row | None:
        """A row with its value, scatter and repeats; None where nothing was measured."""
        name, unit = (column.name, column.heading.unit) if not self.tidy else self.read_observable(line, row)
        text = row[column.place]
        unseen = cell_word(text) == "no_transport" or (self.tidy and not text)
        cell = CellNumber(nan, -inf) if unseen else self.read_number(line, row, column, single=False)
        if is_missing(text) and not unseen:
            if self.tidy:
                self.add_fault(line, column, row, reason(text))
            return None
        n = next((self.count(line, row, each) for each in self.partner_columns("n", column)), None)
        counting = column, *self.partner_columns("sd", column), *self.partner_columns("se", column)
        n = n or max(each.heading.repeats for each in counting) or None
        sd = self.read_sd(line, row, column, cell.value, n) if isnan(cell.sd) else cell.sd
        if not isnan(cell.sd) and STANDARD_ERROR.search(column.heading.text):
            sd = self.sd_of_standard_error(line, row, column, sd, n)
        if sd > MOST_SCATTER * abs(cell.value) > 0.0:
            self.add_fault(line, column, row, f"has a scatter of {sd:g}: leave it away where it is not known")
        if sd == 0.0:  # of a few repeats that differ by less than a digit
            self.exact.append(line)
        if isnan(sd or nan):  # what the user states
            sd = column.cv * abs(cell.value) or nan
            sd = sd if isnan(column.sd) else column.sd * self.column_unit_factor(line, row, column)
        values = {"observable": name, "value": cell.value, "censored": cell.reach != 0.0, "reach": cell.reach}
        return replace(shared, **values, sd=sd, n=n, unit=unit or "1")

    def read_observable(self, line: int, row: Sequence[str]) -> tuple[str, str]:
        """Observable and unit of a row of a tidy table."""
        (name,), (unit,) = self.columns_with("observable"), self.columns_with("unit")
        if not NAME.fullmatch(row[name.place]):
            self.add_fault(line, name, row, "must be a name")
        try:
            parse_unit(row[unit.place])
            return row[name.place], row[unit.place]
        except UnknownUnit as error:
            self.add_fault(line, unit, row, f"is not known; {error.hint or f'allowed: {EXAMPLES}'}")
            return row[name.place], "1"

    def read_number(
        self, line: int, row: Sequence[str], column: Column, single: bool = True, unit: str | None = None
    ) -> CellNumber:
        """Number of a cell in a unit, else that of its column; nothing, and a fault, where there is none."""
        unit_of_heading = column.heading.unit
        try:
            cell = read_cell(row[column.place], self.cells.decimal_comma, single, column.role == "condition")
            scale = self.cell_scale(cell.unit or unit_of_heading, unit_of_heading if unit is None else unit)
        except CellFault as fault:
            self.add_fault(line, column, row, fault)
            return CellNumber()
        own_factor = self.column_unit_factor(line, row, column)
        factor = scale.factor * own_factor
        if (factor, scale.origin) == (1.0, 0.0):
            return cell
        reach = cell.reach * factor
        return CellNumber(own_factor * scale.to_use(cell.value), reach, cell.sd * factor, cell.unit)

    def column_unit_factor(self, line: int, row: Sequence[str], column: Column) -> float:
        """From the numbers of a column to what it measures or sets; of a wind over the bed of its row."""
        if column.roughness < 0:
            return column.factor
        bed = next(each for each in self.columns if each.place == column.roughness)
        length = self.read_number(line, row, bed, unit="m").value
        if 0.0 < length < LOWEST_WIND * column.height:
            return friction_velocity_ratio(column.height, length)
        message = f"must lie above 0 and below a tenth of the height of the wind, {column.height:g} m"
        self.add_fault(line, bed, row, message)
        return nan

    def cell_scale(self, written: str, unit: str) -> Scale:
        """Scale from the unit behind a number to that of its column; raises CellFault."""
        if not written or written == unit or (self.tidy and not unit):
            return Scale()
        try:
            unit_scale = scale_between(written, parse_scale(unit)) if unit else None
        except UnknownUnit as error:
            hint = error.hint or "write the number alone"
            raise CellFault(f"has the unit '{written}', which is not known; {hint}") from None
        if unit_scale is None:
            message = f"a column in {unit}" if unit else "a column without unit"
            raise CellFault(f"is a number in {written} in {message}")
        return unit_scale

    def read_positive(self, line: int, row: Sequence[str], column: Column, unit: str | None = None) -> float:
        """A number that is not negative; NaN, and a fault, for another one."""
        number = self.read_number(line, row, column, unit=unit).value
        if number < 0.0:
            self.add_fault(line, column, row, "must be above 0; leave it empty where it is not known")
            return nan
        return number

    def partner_columns(self, role: Role, column: Column) -> list[Column]:
        """Columns of scatter or repeats that belong to an observable."""
        return [other for other in self.columns_with(role) if other.of in (column.place, -1)]

    def read_sd(self, line: int, row: Sequence[str], column: Column, value: float, n: int | None) -> float:
        """Standard deviation of single repeats from a column of its own; NaN where none is given."""
        for other in (*self.partner_columns("sd", column), *self.partner_columns("se", column)):
            like = replace(other, factor=column.factor, roughness=column.roughness, height=column.height)
            sd = self.read_positive(line, row, like, column.heading.unit)
            if not isnan(sd):
                return self.sd_of_standard_error(line, row, column, sd, n) if other.role == "se" else sd
        for other in self.partner_columns("cv", column):
            sd = SHARES.get(other.heading.unit, 0.01) * self.read_positive(line, row, other)
            if not isnan(sd):
                return sd * abs(value)
        return nan

    def sd_of_standard_error(
        self, line: int, row: Sequence[str], column: Column, error: float, n: int | None
    ) -> float:
        """Standard deviation of single repeats of a mean with a standard error; a fault without n."""
        if n is None:
            self.add_fault(line, column, row, "has a standard error: give n, the number of repeats")
        return error * sqrt(n or nan)

    def count(self, line: int, row: Sequence[str], column: Column) -> int | None:
        """Number of repeats; None where none is given."""
        number = self.read_number(line, row, column).value
        if isnan(number):
            return None
        if number != int(number) or not 1 <= number <= MOST_REPEATS:
            self.add_fault(line, column, row, f"must be a whole number from 1 to {MOST_REPEATS:g}")
            return None
        return int(number)

    def text(self, row: Sequence[str], role: Role) -> str:
        """Words of a row in the columns of a role."""
        return ", ".join(row[column.place] for column in self.columns_with(role) if row[column.place])

    def read_vault_draw(self, line: int, row: Sequence[str]) -> Drawn:
        """What became of a row when rows were drawn for the vault."""
        text = self.text(row, "vault")
        if text not in get_args(Drawn):
            self.add_fault(line, self.columns_with("vault")[0], row, "must be 'held out', 'fitted' or empty")
        return text  # pyright: ignore[reportReturnType]


def quote_cell(text: str) -> str:
    clean = "".join(sign if sign.isprintable() else "?" for sign in text[: SHOWN + 1])
    return f"'{clean}'" if len(clean) <= SHOWN else f"'{clean[: SHOWN - 3]}...'"


def row_sources(sources: Sequence[str]) -> tuple[str, ...]:
    """Sources of rows: those that name no other are of one source, their file."""
    places = [PLACE.fullmatch(source) for source in sources]
    return tuple(place["file"] if place else source for place, source in zip(places, sources, strict=True))


def tidy_table_cells(table: Table) -> list[dict[str, str]]:
    names = [f"{n} [{u}]" if u else n for n, u in zip(table.conditions, table.units, strict=True)]
    errors = {each: "set " if each in table.set_conditions else "" for each in table.conditions}
    errors = {n: t for n, t in errors.items() if any(n in row.condition_sd for row in table.rows)}
    units = dict(zip(table.conditions, names, strict=True))
    cells, repeats = [], any(row.repeat for row in table.rows)
    for row in table.rows:
        value = {-inf: "<", inf: ">"}.get(row.reach if row.censored else 0.0, "") + cell_text(row.value)
        if row.censored and isfinite(row.reach):
            value = f"{cell_text(row.value - row.reach)}..{cell_text(row.value + row.reach)}"
        first = (row.observable, value if isfinite(row.value) else "no transport", cell_text(row.sd))
        fields = dict(zip(("observable", "value", "sd"), first, strict=True))
        fields |= {"n": str(row.n or ""), "unit": row.unit, "group": row.group, "vault": row.draw}
        fields |= dict(zip(names, map(cell_text, row.conditions), strict=True))
        fields |= {f"sd of {t}{units[n]}": cell_text(row.condition_sd.get(n, nan)) for n, t in errors.items()}
        cells.append(fields | ({"replicate": row.repeat} if repeats else {}) | {"source": row.source})
    return cells


def cell_text(number: float) -> str:
    """A number as a cell; empty for none."""
    return f"{number:.12g}" if isfinite(number) else ""
