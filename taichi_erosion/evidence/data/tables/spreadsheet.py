"""Cells of a table as spreadsheets export it: text with any usual separator and code page, or a workbook.

What the export leaves open is found out: the code page (UTF-8, else by `charset_normalizer`), the separator
(semicolon, tab or comma), the decimal mark, and the row of the heading, above which titles may stand. Second
rows of headings, rows of units, and headings of merged cells are put into one heading for each column.
"""

import csv
import io
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import digest_of, regular_file
from taichi_erosion.evidence.data.tables.cell_numbers import (
    NUMBER,
    has_decimal_comma,
    is_missing,
    is_quantity,
)
from taichi_erosion.evidence.data.tables.headings import read_heading, unit_in
from taichi_erosion.evidence.data.tables.vocabulary import meaning_of
from taichi_erosion.scene.load import refuse_other_kind

LARGEST_FILE = 20_000_000  # bytes; no table of measurements is larger
SEPARATORS = {";": "semicolons", "\t": "tabs", ",": "commas"}
WESTERN = frozenset("°µ±²³·–—…„“”‘’«»×½¼€§ÄÖÜäöüßÀÂÇÈÉÊËÎÏÔÙÛàâçèéêëîïôùûÁÍÑÓÚáíñóúÃÕãõÅÆØåæøÌÒìò¿¡ºª´\u00a0")
CODE_PAGES = ["cp1252", "cp1250", "cp1251", "cp1253", "cp1254", "mac_roman", "gb18030", "big5", "shift_jis"]
WORKBOOK, OLD_WORKBOOK = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"  # first bytes
MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}  # of an encoding
ONE_COLUMN = re.compile(rf"[^,;\t\n]+(?:\n{NUMBER})+", re.ASCII)  # of numbers with decimal commas
Lines = list[tuple[int, list[str]]]  # row in the file from 1, cells


@dataclass(frozen=True)
class Cells:
    """A table of cells without surrounding blanks; rows without any content are left out."""

    file: str
    rows: tuple[tuple[int, tuple[str, ...]], ...]  # row in the file from 1, cells; the heading first
    decimal_comma: bool = False
    form: str = ""  # how the file was read, in words

    @property
    def heading(self) -> tuple[str, ...]:
        return self.rows[0][1]

    @property
    def lines(self) -> tuple[tuple[int, tuple[str, ...]], ...]:
        """Rows below the heading."""
        return self.rows[1:]


def read_cells(path: Path, name: str, faults: list[str]) -> Cells:
    """Cells of a file; rows that do not fit are left out and added to `faults`. Raises BadInput."""
    if path.suffix.lower() == ".toml" or path.is_dir():
        refuse_other_kind(path, "table")
    content = file_bytes(path, name)
    if content.startswith(OLD_WORKBOOK) or path.suffix.lower() in (".xls", ".ods", ".numbers"):
        raise BadInput(f"{name}: this kind of workbook is not read; save it as .xlsx or .csv")
    if content.startswith(WORKBOOK):
        rows, comma, form = workbook_rows(content, name)
        separator = ""
    elif path.suffix.lower() in (".xlsx", ".xlsm"):
        raise BadInput(f"{name}: is no workbook; save it again as .xlsx or .csv")
    else:
        text, encoding = decoded(content, name)
        separator = separator_of(text)
        rows = text_rows(text, separator, name)
        comma = has_decimal_comma((cell for _, cells in rows for cell in cells), separator)
        mark = "decimal commas" if comma else "decimal points"
        form = f"text ({encoding}), columns separated by {SEPARATORS[separator]}, {mark}"
    start = next((k for k, (_, cells) in enumerate(rows) if sum(map(bool, cells)) > 1), 0)  # below titles
    rows, again = one_table(rows[start:])
    lines = rectangular(with_one_heading(rows), name, separator, faults)
    return Cells(name, tuple(lines), comma, form + again)


def file_bytes(path: Path, name: str) -> bytes:
    """Content of a regular file of reasonable size."""
    try:
        if (size := regular_file(path).stat().st_size) > LARGEST_FILE:
            raise BadInput(f"{name}: {size} bytes are too many; at most {LARGEST_FILE}")
        return path.read_bytes()
    except FileNotFoundError:
        raise BadInput(f"{name}: no such file") from None
    except (OSError, ValueError) as error:
        raise BadInput(f"{name}: cannot be read: {str(error).splitlines()[0]}") from None


def decoded(content: bytes, name: str) -> tuple[str, str]:
    """Text of a file and the name of its encoding."""
    marked = next((code for mark, code in MARKS.items() if content.startswith(mark)), None)
    for encoding in (marked or "utf-8", "cp1252"):
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        foreign = {sign for sign in text if ord(sign) > 127}
        if "\0" not in text and (encoding != "cp1252" or foreign <= WESTERN):
            return text.removeprefix("\ufeff"), encoding.removesuffix("-sig")
    from charset_normalizer import from_bytes

    best = from_bytes(content, cp_isolation=CODE_PAGES).best()
    if best is None or "\0" in str(best) or b"\0" in content:
        raise BadInput(f"{name}: is no text in any usual code page; save it as 'CSV UTF-8' or .xlsx")
    return str(best), best.encoding


def separator_of(text: str) -> str:
    """Separator that makes the most rows as wide as the widest of the first ones."""
    lines = [line for line in text.splitlines()[:200] if line.strip(" ;,\t")]
    declared = lines[0].strip() if lines else ""
    if declared.lower().startswith("sep=") and declared[4:5] in SEPARATORS:
        return declared[4]
    if ONE_COLUMN.fullmatch("\n".join(lines)):
        return ";"

    def even_rows(separator: str) -> tuple[int, int]:
        widths = [len(row) for row in csv.reader(lines, delimiter=separator)]
        commonest = max(widths, key=widths.count, default=1)
        return (widths.count(commonest) if commonest > 1 else 0), commonest

    try:
        found = {separator: even_rows(separator) for separator in SEPARATORS}
    except csv.Error:
        return ","
    wide = [separator for separator in SEPARATORS if found[separator][0]]
    return max(wide, key=lambda s: (found[s][0] > 0.5 * len(lines), s != ",", found[s]), default=",")


def text_rows(text: str, separator: str, name: str) -> Lines:
    """Rows with content."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    rows, before = [], 0
    try:
        for cells in reader:
            stripped = [" ".join(cell.split()) for cell in cells]
            if any(stripped) and not stripped[0].lower().startswith("sep="):
                rows.append((before + 1, stripped))
            before = reader.line_num
    except csv.Error as error:
        told = f"not a table of cells: {error}; look for a lone quote"
        raise BadInput(f"{name}: row {before + 1}: {told}") from None
    return rows


def workbook_rows(content: bytes, name: str) -> tuple[Lines, bool, str]:
    """Rows of the first sheet with columns of numbers, else of the first one; decimal comma; form."""
    sheets = [(title, rows) for title, rows in sheets_of(content, name) if rows]
    if not sheets:
        raise BadInput(f"{name}: its sheets are empty")
    tables = [sheet for sheet in sheets if holds_table(sheet[1])]
    title, rows = (tables or sheets)[0]
    comma = has_decimal_comma((v for _, row in rows for v in row if isinstance(v, str)), "")
    form = f"workbook, sheet '{title}'"
    if others := [repr(other) for other, _ in sheets if other != title]:
        remedy = f"; to use a table there, put its rows below those of '{title}'" if tables[1:] else ""
        form += f" (not read: {', '.join(others)}{remedy})"
    mark = "," if comma else "."
    return [(line, [cell_text(value, mark) for value in row]) for line, row in rows], comma, form


def holds_table(rows: Sequence[tuple[int, list[Any]]]) -> bool:
    """Whether a sheet has two numbers or more in a row, in two rows or more."""
    texts = ([cell_text(value, ".") for value in values] for _, values in rows)
    return sum(sum(is_quantity(text) for text in row if any(map(str.isdigit, text))) > 1 for row in texts) > 1


def sheets_of(content: bytes, name: str) -> Iterator[tuple[str, list[tuple[int, list[Any]]]]]:
    """Title and rows with content of visible sheets. Raises BadInput for formulas without a value."""
    import openpyxl

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of styles and checks that no value depends on
            book, formulas = (
                openpyxl.load_workbook(io.BytesIO(content), data_only=values) for values in (True, False)
            )
    except Exception as error:
        raise BadInput(
            f"{name}: cannot be read as a workbook ({type(error).__name__}); save it again"
        ) from None
    for sheet in (each for each in book.worksheets if each.sheet_state == "visible"):
        for cell in (cell for row in formulas[sheet.title].iter_rows() for cell in row):
            value = sheet[cell.coordinate]
            # an empty text that was computed has the type of a text
            if cell.data_type == "f" and value.value is None and value.data_type == "n":
                place, remedy = f"sheet '{sheet.title}', cell {cell.coordinate}", "open the workbook in a"
                told = f"a formula that was never computed; {remedy} spreadsheet program, and save it there"
                raise BadInput(f"{name}: {place}: {told}")
        rows = [(k, [cell_value(cell) for cell in row]) for k, row in enumerate(sheet.iter_rows(), 1)]
        yield sheet.title, [(k, row) for k, row in rows if any(v not in (None, "") for v in row)]


def cell_value(cell: Any) -> Any:
    """Value of a cell; a number that is shown as a percentage is text."""
    value = cell.value
    if isinstance(value, int | float) and not isinstance(value, bool) and "%" in str(cell.number_format):
        return f"{100.0 * value:.12g} %"
    return " ".join(value.split()) if isinstance(value, str) else value


def cell_text(value: Any, mark: str) -> str:
    """Text of a cell's value."""
    if value is None:
        return ""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return f"{value:.12g}".replace(".", mark)
    return str(value)


def one_table(rows: Lines) -> tuple[Lines, str]:
    """The rows without titles, headings and units that stand again above more rows, and what is told."""
    plain = [cells[: last_filled(cells)] for _, cells in rows]
    again = [k for k in range(1, len(plain)) if plain[k] == plain[0]]
    left_out = set(again)
    for k in again:
        if k > 1 and sum(map(bool, plain[k - 1])) == 1:
            left_out.add(k - 1)
        if plain[k + 1 : k + 2] == plain[1:2] and not has_digit(plain[1]):
            left_out.add(k + 1)
    told = f", headings again in row {', '.join(str(rows[k][0]) for k in again)}" if again else ""
    return [row for k, row in enumerate(rows) if k not in left_out], told


def last_filled(cells: Sequence[str]) -> int:
    """Number of cells up to the last one with content."""
    return max((k + 1 for k, cell in enumerate(cells) if cell), default=0)


def has_digit(cells: Sequence[str]) -> bool:
    """Whether any cell holds a digit."""
    return any(sign.isdigit() for cell in cells for sign in cell)


def with_one_heading(rows: Lines) -> Lines:
    """The rows with one row of headings, units in brackets; cells without a heading above numbers are named.

    A merged heading arrives as one with blanks to the right of it: it stands above these columns too. A
    second row of headings belongs to them; without one the columns of a measured quantity are numbered.
    """
    if len(rows) < 2:
        return rows
    (line, first), *others = rows
    width = max(len(cells) for _, cells in rows)
    heading, second = first + [""] * (width - len(first)), [cell.strip("[]() ") for cell in others[0][1]]
    second += [""] * (width - len(second))
    filled = [cell for cell in second if cell]
    units = len(filled) > 1 and len(others) > 1 and not has_digit(filled) and all(map(unit_in, filled))
    if units:
        others = others[1:]
    elif len(filled) > 1 and not has_digit(filled) and any(map(lambda a, b: b and not a, heading, second)):
        heading, others = list(joined_headings(heading, others[0][1])), others[1:]
        units, second = False, [""] * width
    heading = numbered(heading, second if units else [""] * width, others)
    return [(line, heading[: last_filled(heading)]), *others]


def joined_headings(above: Sequence[str], below: Sequence[str]) -> Iterator[str]:
    """Heading of each column from two rows: `repose angle` above `SD [deg]`; a lone unit gets brackets."""
    last = ""
    for place, text in enumerate(above):
        under = below[place] if place < len(below) else ""
        last = text or last
        name = last if under else text
        yield bracketed(name, under) if name and unit_in(under.strip("[]() ")) else f"{name} {under}".strip()


def bracketed(name: str, unit: str) -> str:
    """A heading with its unit in brackets, where it has none yet."""
    unit = unit.strip("[]() ")
    return f"{name} [{unit}]" if name and unit and not read_heading(name).unit else name


def numbered(heading: Sequence[str], units: Sequence[str], rows: Lines) -> list[str]:
    """Headings with units; blank ones right of a measured quantity, above numbers, are numbered as it is."""
    found, first, count = list(map(bracketed, heading, units)), 0, 1
    for k in range(1, len(heading)):
        measured = meaning_of(read_heading(heading[first]).name)[0] == "observable"
        if heading[k] or not measured or not numbered_column(rows, k):
            first, count = k, 1
            continue
        count += 1
        if count == 2:
            found[first] = bracketed(f"{heading[first]} 1", units[first])
        found[k] = bracketed(f"{heading[first]} {count}", units[k] or units[first])
    return found


def numbered_column(rows: Lines, place: int) -> bool:
    """Whether most cells with content of a column are numbers."""
    content = [row[place] for _, row in rows if place < len(row) and not is_missing(row[place])]
    numbers = [cell for cell in content if has_digit(cell) and is_quantity(cell)]
    return len(numbers) > 0.5 * len(content)


def rectangular(
    rows: Lines, name: str, separator: str, faults: list[str]
) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Rows as wide as the heading, others are faults; empty columns behind the last heading are cut off."""
    if not rows:
        return
    width = last_filled(rows[0][1])
    hint = "; put text with commas into quotes, write decimals with a point" if separator == "," else ""
    if len(rows) > 2 and all(last_filled(cells) > width for _, cells in rows[1:]):
        faults.append(
            f"{name}: row {rows[0][0]} has {width} headings, the rows below it more cells: write one "
            "heading in one row above every column, without merged cells"
        )
        return
    for line, cells in rows:
        filled = last_filled(cells)
        if width >= filled and len(cells) >= width:
            yield line, tuple(cells[:width])
            continue
        second = not has_digit(cells) and filled > 1
        remedy = "; a second table? keep one table in a file" if second else hint
        faults.append(f"{name}: row {line} has {max(filled, len(cells))} cells, the heading {width}{remedy}")


def source_digest(table: Path) -> str:
    """Digest of the cells by which a laboratory's table is known again; empty where it is unreadable."""
    try:
        rows = read_cells(table, table.name, []).rows
    except BadInput:
        return ""
    return digest_of(repr([cells for _, cells in rows]).encode())


def source_changed(table: Path, digest: str) -> bool:
    """Whether a table is there and has other cells than those of a digest."""
    return table.is_file() and source_digest(table) != digest
