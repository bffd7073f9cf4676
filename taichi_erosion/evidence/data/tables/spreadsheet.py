"""Cells of a table as spreadsheets export it: text with any usual separator and code page, or a workbook.

What the export leaves open is found out: the code page (UTF-8, else by `charset_normalizer`), the separator
(semicolon, tab or comma), the decimal mark, and the row of the heading, above which titles may stand.
"""

import csv
import io
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.tables.cell_numbers import (
    MISSING,
    has_decimal_comma,
    is_quantity,
    plain_cell,
)
from taichi_erosion.evidence.data.tables.headings import read_heading, unit_in
from taichi_erosion.evidence.data.tables.vocabulary import meaning_of
from taichi_erosion.scene.file_kind import refuse_other_kind

LARGEST_FILE = 20_000_000  # bytes; no table of measurements is larger
SEPARATORS = {";": "semicolons", "\t": "tabs", ",": "commas"}
WESTERN = frozenset("°µ±²³·–—…„“”‘’«»×½¼€§ÄÖÜäöüßÀÂÇÈÉÊËÎÏÔÙÛàâçèéêëîïôùûÁÍÑÓÚáíñóúÃÕãõÅÆØåæøÌÒìò¿¡ºª´\u00a0")
CODE_PAGES = ["cp1252", "cp1250", "cp1251", "cp1253", "cp1254", "mac_roman", "gb18030", "big5", "shift_jis"]
WORKBOOK, OLD_WORKBOOK = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"  # first bytes
MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}  # of an encoding
DIGITS = 16  # of the digest


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
        return workbook_cells(content, name, faults)
    if path.suffix.lower() in (".xlsx", ".xlsm"):
        raise BadInput(f"{name}: is no workbook; save it again as .xlsx or .csv")
    text, encoding = decoded(content, name)
    separator = separator_of(text)
    rows = list(text_rows(text, separator, name))
    comma = has_decimal_comma((cell for _, cells in rows for cell in cells), separator)
    mark = "decimal commas" if comma else "decimal points"
    form = f"text ({encoding}), columns separated by {SEPARATORS[separator]}, {mark}"
    parts, again = one_table(rows)
    lines = with_blank_headings(parts)
    return Cells(name, tuple(rectangular(lines, name, separator, faults)), comma, form + again)


def file_bytes(path: Path, name: str) -> bytes:
    """Content of a regular file of reasonable size."""
    try:
        if not path.is_file():
            raise BadInput(f"{name}: {'is not a file' if path.exists() else 'no such file'}")
        if path.stat().st_size > LARGEST_FILE:
            raise BadInput(f"{name}: {path.stat().st_size} bytes are too many; at most {LARGEST_FILE}")
        return path.read_bytes()
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
            return text, encoding.removesuffix("-sig")
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


def text_rows(text: str, separator: str, name: str) -> Iterator[tuple[int, list[str]]]:
    """(row in the file, cells) of every row with content, from the heading on."""
    reader = csv.reader(
        io.StringIO(text.removeprefix("\ufeff"), newline=""), delimiter=separator, strict=True
    )
    rows, before = [], 0
    try:
        for cells in reader:
            stripped = [" ".join(cell.split()) for cell in cells]
            if any(stripped) and not stripped[0].lower().startswith("sep="):
                rows.append((before + 1, stripped))
            before = reader.line_num
    except csv.Error as error:
        raise BadInput(
            f"{name}: row {before + 1}: not a table of cells: {error}; look for a lone quote"
        ) from None
    return below_titles(rows)


def below_titles(rows: Sequence[tuple[int, list[str]]]) -> Iterator[tuple[int, list[str]]]:
    """The rows from the heading on: the first row with two cells that have content."""
    start = next((k for k, (_, cells) in enumerate(rows) if sum(map(bool, cells)) > 1), 0)
    yield from rows[start:]


def one_table(rows: Sequence[tuple[int, list[str]]]) -> tuple[list[tuple[int, list[str]]], str]:
    """The rows without titles, headings and units that stand again above more rows, and what is told."""
    plain = [cells[: last_filled(cells)] for _, cells in rows]
    again = [k for k in range(1, len(plain)) if plain[k] == plain[0]]
    left_out = set(again)
    for k in again:
        if k > 1 and sum(map(bool, plain[k - 1])) == 1:
            left_out.add(k - 1)
        if plain[k + 1 : k + 2] == plain[1:2] and not any(sign.isdigit() for sign in "".join(plain[1])):
            left_out.add(k + 1)
    told = f", headings again in row {', '.join(str(rows[k][0]) for k in again)}" if again else ""
    return [row for k, row in enumerate(rows) if k not in left_out], told


def with_blank_headings(rows: Sequence[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """Rows whose blank headings, right of a measured quantity and above numbers, are numbered as it is.

    So a merged heading arrives in a text.
    """
    if not rows:
        return []
    (line, heading), *others = rows
    width = max(len(cells) for _, cells in rows)
    filled = [*heading, *[""] * (width - len(heading))]
    first, count = 0, 1
    for k in range(1, width):
        if (
            filled[k]
            or not numbered_column(others, k)
            or meaning_of(read_heading(filled[first]).name)[0] != "observable"
        ):
            first, count = k, 1
            continue
        count += 1
        filled[k] = f"{heading[first]} {count}"
    names = set(filled)
    filled = [f"{text} 1" if text and f"{text} 2" in names else text for text in filled]
    return [(line, filled[: last_filled(filled)]), *others]


def numbered_column(rows: Sequence[tuple[int, list[str]]], place: int) -> bool:
    """Whether most cells with content of a column are numbers."""
    cells = [row[place] for _, row in rows if place < len(row)]
    content = [cell for cell in cells if plain_cell(cell).lower() not in MISSING]
    numbers = [cell for cell in content if any(map(str.isdigit, cell)) and is_quantity(cell)]
    return len(numbers) > 0.5 * len(content)


def rectangular(
    rows: Sequence[tuple[int, list[str]]], name: str, separator: str, faults: list[str]
) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Rows as wide as the heading, others are faults; empty columns behind the last heading are cut off."""
    if not rows:
        return
    heading = rows[0][1]
    width = last_filled(heading)
    hint = "; put text with commas into quotes, write decimals with a point" if separator == "," else ""
    lines = with_unit_row(rows)
    if len(lines) > 2 and all(last_filled(cells) > width for _, cells in lines[1:]):
        faults.append(
            f"{name}: row {lines[0][0]} has {width} headings, the rows below it more cells: write one "
            "heading in one row above every column, without merged cells"
        )
        return
    for line, cells in lines:
        filled = last_filled(cells)
        if filled > width or (len(cells) < width and len(cells) < len(heading)):
            count = max(filled, len(cells)) if filled > width else len(cells)
            second = not any(sign.isdigit() for cell in cells for sign in cell) and filled > 1
            remedy = "; a second table? keep one table in a file" if second else hint
            faults.append(f"{name}: row {line} has {count} cells, the heading {width}{remedy}")
        else:
            yield line, tuple(cells[:width])


def last_filled(cells: Sequence[str]) -> int:
    """Number of cells up to the last one with content."""
    return max((k + 1 for k, cell in enumerate(cells) if cell), default=0)


def with_unit_row(rows: Sequence[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """The rows with a row of units right below the heading put into it, in brackets."""
    if len(rows) < 3:
        return list(rows)
    (line, heading), (_, units), *others = rows
    stated = [unit.strip("[]() ") for unit in units]
    filled = [unit for unit in stated if unit]
    numbered = any(unit.isdigit() for unit in filled)
    if len(filled) < 2 or numbered or not all(map(unit_in, filled)) or len(units) > len(heading):
        return list(rows)
    merged = [
        f"{name} [{unit}]" if name and unit and not read_heading(name).unit else name
        for name, unit in zip(heading, [*stated, *[""] * (len(heading) - len(stated))], strict=True)
    ]
    for k, text in enumerate(merged[1:], 1):  # the unit of a merged cell stands below the first repeat alone
        before = read_heading(merged[k - 1])
        if before.unit and text and text == heading[k] and unnumbered(text) == unnumbered(heading[k - 1]):
            merged[k] = f"{text} [{before.unit}]"
    return [(line, merged), *others]


def unnumbered(heading: str) -> str:
    """A heading without the number at its end."""
    return re.sub(r"\s*\d+$", "", heading)


def workbook_cells(content: bytes, name: str, faults: list[str]) -> Cells:
    """Cells of the first sheet with columns of numbers of a workbook, else of the first with content."""
    sheets = [(title, rows, merged) for title, rows, merged in sheets_of(content, name) if rows]
    if not sheets:
        raise BadInput(f"{name}: its sheets are empty")
    tables = [sheet for sheet in sheets if holds_table(sheet[1])]
    title, rows, merged = (tables or sheets)[0]
    texts = [value for _, values in rows for value in values if isinstance(value, str)]
    comma = has_decimal_comma(texts, "")
    mark = "," if comma else "."
    shown = [(line, [cell_text(value, mark) for value in values]) for line, values in rows]
    form = f"workbook, sheet '{title}'"
    others = [repr(other) for other, _, _ in sheets if other != title]
    if others:
        remedy = f"; to use a table there, put its rows below those of '{title}'" if tables[1:] else ""
        form += f" (not read: {', '.join(others)}{remedy})"
    parts, again = one_table(list(below_titles(shown)))
    below = with_blank_headings(with_merged_headings(parts, merged))
    return Cells(name, tuple(rectangular(below, name, "", faults)), comma, form + again)


def holds_table(rows: Sequence[tuple[int, list[Any]]]) -> bool:
    """Whether a sheet has two numbers or more in a row, in two rows or more."""
    texts = ([cell_text(value, ".") for value in values] for _, values in rows)
    return sum(sum(is_quantity(text) for text in row if any(map(str.isdigit, text))) > 1 for row in texts) > 1


def with_merged_headings(
    rows: Sequence[tuple[int, list[str]]], merged: Sequence[tuple[int, int, int]]
) -> list[tuple[int, list[str]]]:
    """Rows below titles; a heading of merged cells stands above each of its columns.

    A second row of headings below it belongs to it; without one its columns are numbered.
    """
    if not rows:
        return []
    (line, heading), *others = rows
    spread = {
        place: (first, place - first + 1)
        for row, first, last in merged
        if row == line and heading[first]
        for place in range(first + 1, min(last + 1, len(heading)))
    }
    if spread and others and is_second_heading(others[0][1]):
        above = [heading[spread[k][0]] if k in spread else text for k, text in enumerate(heading)]
        return [(line, list(map(joined_heading, above, others[0][1]))), *others[1:]]
    filled = [f"{heading[spread[k][0]]} {spread[k][1]}" if k in spread else t for k, t in enumerate(heading)]
    return [(line, filled), *others]


def is_second_heading(cells: Sequence[str]) -> bool:
    """Whether a row below merged headings holds headings too: words, and not units alone."""
    filled = [cell.strip("[]() ") for cell in cells if cell]
    numbers = any(cell.replace(",", "").replace(".", "").isdigit() for cell in filled)
    return len(filled) > 1 and not numbers and not all(map(unit_in, filled))


def joined_heading(above: str, below: str) -> str:
    """Heading of a column from two rows: `repose angle` above `SD [deg]`; a unit alone goes into brackets."""
    unit = below.strip("[]() ")
    if below and above and unit_in(unit) and not read_heading(above).unit:
        return f"{above} [{unit}]"
    return f"{above} {below}".strip()


def sheets_of(
    content: bytes, name: str
) -> list[tuple[str, list[tuple[int, list[Any]]], list[tuple[int, int, int]]]]:
    """Title, rows with content and cells merged along a row (row, first and last place) of visible sheets.

    Percentages are text with their sign.
    """
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
    refuse_uncomputed(book, formulas, name)
    found = []
    for sheet in book.worksheets:
        rows = [(k, [cell_value(cell) for cell in row]) for k, row in enumerate(sheet.iter_rows(), 1)]
        if sheet.sheet_state == "visible":
            filled = [(k, row) for k, row in rows if any(v not in (None, "") for v in row)]
            areas = [each for each in sheet.merged_cells.ranges if each.min_row == each.max_row]
            found.append((sheet.title, filled, [(m.min_row, m.min_col - 1, m.max_col - 1) for m in areas]))
    return found


def refuse_uncomputed(book: Any, formulas: Any, name: str) -> None:
    """Raise BadInput for a formula without the value that a spreadsheet program computes and saves."""
    remedy = "open the workbook in a spreadsheet program, and save it there"
    for sheet in (each for each in book.worksheets if each.sheet_state == "visible"):
        for cell in (cell for row in formulas[sheet.title].iter_rows() for cell in row):
            value = sheet[cell.coordinate]
            # an empty text that was computed has the type of a text
            if cell.data_type == "f" and value.value is None and value.data_type == "n":
                place = f"{name}: sheet '{sheet.title}', cell {cell.coordinate}"
                raise BadInput(f"{place}: a formula that was never computed; {remedy}")


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


def source_digest(table: Path) -> str:
    """Digest of the cells by which a laboratory's table is known again; empty where it is unreadable."""
    try:
        rows = read_cells(table, table.name, []).rows
    except BadInput:
        return ""
    return sha256(repr([cells for _, cells in rows]).encode()).hexdigest()[:DIGITS]


def source_changed(table: Path, digest: str) -> bool:
    """Whether a table is there and has other cells than those of a digest."""
    return table.is_file() and source_digest(table) != digest
