"""Cells of a table as spreadsheets export it, text with any usual separator and code page or a workbook.

What the export leaves open is found out: the code page (UTF-8, else by `charset_normalizer`), the separator
(semicolon, tab or comma), the decimal mark, and the row of the heading, above which titles may stand. A row
of units and a second row of headings below merged cells are put into one heading for each column.

Numbers of cells are read by `cell_numbers`.
"""

import csv
import io
import re
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import accumulate, zip_longest
from math import inf, isclose, isnan
from pathlib import Path
from statistics import fmean
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import content_digest, require_regular_file
from taichi_erosion.scene.load import refuse_other_kind
from taichi_erosion.tables.cell_numbers import (
    NUMBER,
    cell_word,
    cells_with_dittos,
    has_decimal_comma,
    is_missing,
    is_quantity,
    number_or_nan,
    plain_cell,
    read_cell,
)
from taichi_erosion.tables.headings import (
    Heading,
    apply_law,
    has_word,
    is_called_summary,
    is_summary_word,
    known_words,
    last_word,
    meaning_of,
    meaning_of_symbol,
    plain_words,
    read_heading,
    unit_in,
)
from taichi_erosion.tables.number_columns import stem

LARGEST_FILE = 20_000_000  # bytes; no table of measurements is larger
SEPARATORS = {";": "semicolons", "\t": "tabs", ",": "commas", "|": "bars"}
WESTERN = frozenset("°µ±²³·–—…„“”‘’«»×½¼€§ÄÖÜäöüßÀÂÇÈÉÊËÎÏÔÙÛàâçèéêëîïôùûÁÍÑÓÚáíñóúÃÕãõÅÆØåæøÌÒìò¿¡ºª´\u00a0")
CODE_PAGES = ["cp1252", "cp1250", "cp1251", "cp1253", "cp1254", "mac_roman", "gb18030", "big5", "shift_jis"]
WORKBOOK, OLD_WORKBOOK = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"  # first bytes
MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}  # of an encoding
MARK = r"(?:[a-h]{1,4}|[A-H]{1,4})?[*†‡§]{0,4}"  # of groups that do not differ; of significance
MARKED = re.compile(
    rf"(?P<value>[<>]?\s*{NUMBER})\s*(?P<mark>{MARK})(?P<sd>\s*(?:±|\+/-|\+-)\s*{NUMBER})?\s*(?P<last>{MARK})"
)
BRACKETED = re.compile(rf"({NUMBER})\s*[(\[]({NUMBER})[)\]]")  # below `mean (SD)`
SIEVE = re.compile(r"(?i)(?:#|no\.? ?)?[-+]?(\d+)(?:\s*(?:[/–-]|-?\s*\+|to)\s*(\d+))?\s*(?P<unit>mesh|目|#)?")
ONE_ROW = "write one row per sample, with a column for each quantity, its unit in the heading"
NARROW = {sign: sign - 0xFEE0 for sign in range(0xFF01, 0xFF5F)} | {0x2217: "*", 0x204E: "*"}  # `（ｍ）`, ∗
LEFT_OUT = "letters or stars behind numbers are left out"
STEP = 1e-5  # of a difference quotient
ONE_COLUMN = re.compile(rf"[^,;\t\n]+(?:\n{NUMBER})+", re.ASCII)  # of numbers with decimal commas
Lines = list[tuple[int, list[str]]]  # row in the file from 1, cells


@dataclass(frozen=True)
class Cells:
    """A table of cells without surrounding blanks; rows without any content are left out."""

    file: str
    rows: tuple[tuple[int, tuple[str, ...]], ...]  # row in the file from 1, cells; the heading first
    decimal_comma: bool = False
    form: str = ""  # how the file was read, in words
    notes: tuple[str, ...] = ()  # what cells were taken for
    titles: str = ""  # words above and below the table

    @property
    def heading(self) -> tuple[str, ...]:
        return self.rows[0][1]

    @property
    def lines(self) -> tuple[tuple[int, tuple[str, ...]], ...]:
        """Rows below the heading."""
        return self.rows[1:]


def read_table_cells(path: Path, name: str, faults: list[str]) -> Cells:
    """Cells of a file; rows that do not fit are left out and added to `faults`. Raises BadInput."""
    if path.suffix.lower() == ".toml" or path.is_dir():
        refuse_other_kind(path, "table")
    content = read_table_file_bytes(path, name)
    if content.startswith(OLD_WORKBOOK) or path.suffix.lower() in (".xls", ".ods", ".numbers"):
        raise BadInput(f"{name}: this kind of workbook is not read; save it as .xlsx or .csv")
    if content.startswith(WORKBOOK) or path.suffix.lower() in (".xlsx", ".xlsm"):
        rows, comma, form = rows_of_workbook(content, name)
    else:
        text, encoding = decode_text(content, name)
        separator = guess_separator(text)
        rows = rows_of_delimited_text(text, separator, name)
        comma = has_decimal_comma((cell for _, cells in rows for cell in cells), separator)
        mark = "decimal commas" if comma else "decimal points"
        form = f"text ({encoding}), columns separated by {SEPARATORS[separator]}, {mark}"
    rows = [(line, [cell.translate(NARROW) for cell in cells]) for line, cells in rows]
    start = next((k for k, (_, cells) in enumerate(rows) if sum(map(bool, cells)) > 1), 0)  # below titles
    titles = [" ".join(cells) for _, cells in rows[:start]]
    while len(rows) > 1 and len(cells := [*filter(None, rows[-1][1])]) == 1 and not is_quantity(cells[0]):
        titles += rows.pop()[1]  # a footnote
    bare = tuple(trim_rows(name_blank_repeat_columns(with_one_heading(rows[start:])), name, faults))
    full = tuple(accumulate(bare, lambda up, row: (row[0], cells_with_dittos(up[1], row[1]))))
    notes = ("ditto marks count as the cell above",) if full != bare else ()
    cells = Cells(name, full, comma, form, notes, " ".join(titles))
    return apply_number_laws(name_tidy_columns(cells) if cells.lines else cells)


def name_tidy_columns(cells: Cells) -> Cells:
    """The cells; those of a long table, `parameter, value, unit, site`, get the headings of a tidy one.

    Its measured quantities, `angle of repose`, become names of observables.
    """
    plain = [plain_words(text) for text in cells.heading]
    columns = [list(column) for column in zip(*(row for _, row in cells.rows), strict=True)]
    meanings = [[meaning_of(cell) for cell in column[1:]] for column in columns]
    long = [k for k, each in enumerate(meanings) if each and {role for role, _ in each} == {"observable"}]
    for each, column in zip(meanings, columns, strict=True) if "observable" not in plain else ():
        if {"observable", "condition"} <= {role for role, _ in each} and 2 * len({*column}) <= len(column):
            raise BadInput(f"{cells.file}: its quantities stand in rows, below '{column[0]}': {ONE_ROW}")
    is_tidy = "observable" in plain and all(map(str.isidentifier, columns[plain.index("observable")]))
    if not {"value", "unit"} <= {*plain} or len(long) != 1 or is_tidy:
        return cells
    for column, heading in zip(columns, map(read_heading, cells.heading), strict=True):
        (role, name), (kind, symbol) = meaning_of(heading.name), meaning_of_symbol(heading)
        unit = f" [{heading.unit}]" if heading.unit else ""
        if (word := plain_words(heading.name)) in ("value", "unit"):
            column[0] = word
        elif role in ("sd", "n", "group", "source", "remark"):
            column[0] = role + unit * (role == "sd")
        elif kind == "condition" or (role == "condition" and not re.search(r"[^\W\d_]{3}", heading.name)):
            column[0] = (symbol or name).rpartition(".")[2] + unit  # of `d [mm]` or `u*`
    columns[long[0]] = ["observable", *(name for _, name in meanings[long[0]])]
    lines = (line for line, _ in cells.rows)
    return replace(cells, rows=tuple(zip(lines, zip(*columns, strict=True), strict=True)))


def read_table_file_bytes(path: Path, name: str) -> bytes:
    """Content of a regular file of reasonable size."""
    try:
        if (size := require_regular_file(path).stat().st_size) > LARGEST_FILE:
            raise BadInput(f"{name}: {size} bytes are too many; at most {LARGEST_FILE}")
        return path.read_bytes()
    except FileNotFoundError:
        raise BadInput(f"{name}: no such file") from None
    except (OSError, ValueError) as error:
        raise BadInput(f"{name}: cannot be read: {str(error).splitlines()[0]}") from None


def decode_text(content: bytes, name: str) -> tuple[str, str]:
    """Text of a file and the name of its encoding."""
    marked = next((code for mark, code in MARKS.items() if content.startswith(mark)), None)
    for encoding in (marked or "utf-8", "cp1252"):
        with suppress(UnicodeDecodeError):
            text = content.decode(encoding)
            foreign = {sign for sign in text if ord(sign) > 127}
            if "\0" not in text and (encoding != "cp1252" or foreign <= WESTERN):
                return text.removeprefix("\ufeff"), encoding.removesuffix("-sig")
    from charset_normalizer import from_bytes

    best = from_bytes(content, cp_isolation=CODE_PAGES).best()
    if best is None or "\0" in str(best) or b"\0" in content:
        raise BadInput(f"{name}: is no text in any usual code page; save it as 'CSV UTF-8' or .xlsx")
    return str(best), best.encoding


def guess_separator(text: str) -> str:
    """Separator that makes the most rows as wide as the widest of the first ones."""
    lines = [line for line in text.splitlines()[:200] if line.strip(" ;,\t|")]
    declared = lines[0].strip() if lines else ""
    if declared.lower().startswith("sep=") and declared[4:5] in SEPARATORS:
        return declared[4]
    if ONE_COLUMN.fullmatch("\n".join(lines)):
        return ";"
    counts = dict[str, tuple[int, int]]()
    try:
        for separator in SEPARATORS:
            widths = [len(row) for row in csv.reader(lines, delimiter=separator)]
            commonest = max(widths, key=widths.count, default=1)
            if commonest > 1:
                counts[separator] = widths.count(commonest), commonest
    except csv.Error:
        return ","
    half, last = 0.5 * len(lines), "|" if lines and lines[-1].startswith("|") else ","  # of Markdown
    return max(counts, key=lambda s: (counts[s][0] > half, s not in ",|", s == last, counts[s]), default=",")


def rows_of_delimited_text(text: str, separator: str, name: str) -> Lines:
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    rows, before = [], 0
    try:
        for cells in reader:
            stripped = [" ".join(cell.split()) for cell in cells]
            if any(cell.strip(":-") for cell in stripped) and not stripped[0].lower().startswith("sep="):
                rows.append((before + 1, stripped))
            before = reader.line_num
    except csv.Error as error:
        message = f"not a table of cells: {error}; look for a lone quote"
        raise BadInput(f"{name}: row {before + 1}: {message}") from None
    return rows


def rows_of_workbook(content: bytes, name: str) -> tuple[Lines, bool, str]:
    """Rows of the first sheet with columns of numbers, else of the first one; decimal comma; form."""
    sheets = [(title, rows) for title, rows in visible_sheets(content, name) if rows]
    if not sheets:
        raise BadInput(f"{name}: its sheets are empty")
    title, rows = next((sheet for sheet in sheets if sheet_heading(sheet[1])), sheets[0])
    heading = sheet_heading(rows)
    alike = [other for other, lines in sheets if heading and sheet_heading(lines) == heading]
    if len(alike) > 1:
        words = "write one below the other, with a column 'set-up' that names each; hide copies"
        raise BadInput(f"{name}: sheets {', '.join(map(repr, alike))} have the same headings: {words}")
    comma = has_decimal_comma((v for _, row in rows for v in row if isinstance(v, str)), "")
    others, mark = ", ".join(repr(other) for other, _ in sheets if other != title), "," if comma else "."
    form = f"workbook, sheet '{title}'" + (f" (not read: {others})" if others else "")
    return [(line, [workbook_cell_text(value, mark) for value in row]) for line, row in rows], comma, form


def sheet_heading(rows: Sequence[tuple[int, list[Any]]]) -> list[str]:
    """Plain words above the first of two rows or more with two numbers; empty where a sheet has no table."""
    texts = [[workbook_cell_text(value, ".") for value in values] for _, values in rows]
    places = [k for k, row in enumerate(texts) if sum(is_quantity(x) and has_digit([x]) for x in row) > 1]
    return [*filter(None, map(plain_words, texts[places[0] - 1]))] if len(places) > 1 and places[0] else []


def visible_sheets(content: bytes, name: str) -> Iterator[tuple[str, list[tuple[int, list[Any]]]]]:
    """Title and rows with content of visible sheets. Raises BadInput for formulas without a value."""
    import openpyxl

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of styles and checks that no value depends on
            book, formulas = (openpyxl.load_workbook(io.BytesIO(content), data_only=v) for v in (True, False))
    except Exception as error:
        words = f"cannot be read as a workbook ({type(error).__name__}); save it again as .xlsx or .csv"
        raise BadInput(f"{name}: {words}") from None
    for sheet in (each for each in book.worksheets if each.sheet_state == "visible"):
        refuse_hidden_rows(sheet, name)
        for cell in (cell for row in formulas[sheet.title].iter_rows() for cell in row):
            value = sheet[cell.coordinate]
            # an empty text that was computed has the type of a text
            if cell.data_type == "f" and value.value is None and value.data_type == "n":
                words = "a formula that was never computed; save the workbook in a spreadsheet program"
                raise BadInput(f"{name}: sheet '{sheet.title}', cell {cell.coordinate}: {words}")
        rows = [(k, [cell_value(cell) for cell in row]) for k, row in enumerate(sheet.iter_rows(), 1)]
        # a cell merged over rows below the heading counts in each of them, unless it is a measured quantity
        heading = next((k for k, row in rows if sum(v not in (None, "") for v in row) > 1), 0)
        for column, first, _, last in (part.bounds for part in sheet.merged_cells.ranges):
            above = [str(v) for v in rows[heading - 1][1][:column] if v not in (None, "")] if heading else []
            measured = bool(above) and meaning_of(read_heading(above[-1]).name)[0] == "observable"
            for _, row in () if measured or first <= heading else rows[first:last]:
                row[column - 1] = rows[first - 1][1][column - 1]
        yield sheet.title, [(k, row) for k, row in rows if any(v not in (None, "") for v in row)]


def refuse_hidden_rows(sheet: Any, name: str) -> None:
    """Raise BadInput for rows with content that are hidden, or struck through."""
    filled = [cell for row in sheet.iter_rows() for cell in row if cell.value not in (None, "")]
    hidden = [cell.row for cell in filled if sheet.row_dimensions[cell.row].hidden]
    struck = [cell.row for cell in filled if cell.font.strike]
    where = f"{name}: sheet '{sheet.title}', row"
    for rows, words in ((hidden, "hidden: show it"), (struck, "struck through: write it as the others")):
        if rows:
            raise BadInput(f"{where} {rows[0]} is {words} if it counts, else delete it")


def cell_value(cell: Any) -> Any:
    """Value of a cell; a number that is shown as a percentage is text."""
    value = cell.value
    if isinstance(value, int | float) and not isinstance(value, bool) and "%" in str(cell.number_format):
        return f"{100.0 * value:.12g} %"
    return " ".join(value.split()) if isinstance(value, str) else value


def workbook_cell_text(value: Any, mark: str) -> str:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return f"{value:.12g}".replace(".", mark)
    return "" if value is None else str(value)


def filled_width(cells: Sequence[str]) -> int:
    """Number of cells up to the last one with content."""
    return max((k + 1 for k, cell in enumerate(cells) if cell), default=0)


def has_digit(cells: Iterable[str]) -> bool:
    return any(sign.isdigit() for cell in cells for sign in cell)


def with_one_heading(rows: Lines) -> Lines:
    """The rows with one row of headings, units in brackets.

    A row of units below the headings belongs to them, and so does a second row of headings. A merged heading
    arrives as one with blanks to the right of it: it stands above these columns too.
    """
    if len(rows) < 3:
        return rows
    (line, above), (_, below), *others = rows
    filled = [cell for cell in below if cell]
    units = all(map(unit_in, map(strip_brackets, filled)))
    numbers = any(has_digit([cell]) and is_quantity(cell) for cell in filled)
    if len(above) < len(filled) == filled_width(below) and not units and not numbers:
        return with_one_heading(rows[1:])  # above all headings stands a remark with a separator in it
    has_merged = any(under and not text for text, under in zip_longest(above, below, fillvalue=""))
    if has_merged and filled == [str(k + 1) for k in range(len(filled))]:
        return [(line, above), *others]  # numbers of repeats
    if len(filled) < 2 or numbers or not (units or has_merged):
        return rows
    headings, last, sections = list[str](), "", () if units else known_words()["rows"]["section"]
    for text, under in zip_longest(above, below, fillvalue=""):
        last = "" if plain_words(text) in sections else text or last
        name, unit = last if under else text, strip_brackets(under)
        if name and unit_in(unit):
            under = "" if read_heading(name).unit else f"[{unit}]"
        elif meaning_of(symbol := read_heading(under).name)[0] == "sd":
            under = under.replace(symbol, "SD", 1)  # an `s` alone is one
        headings.append(f"{name} {under}".strip())  # `repose angle` above `SD [deg]`
    return [(line, headings), *others]


def strip_brackets(cell: str) -> str:
    """A cell without brackets around the whole of it: `[kg/(m s)]`."""
    return cell[1:-1].strip() if cell[:1] + cell[-1:] in ("[]", "()") else cell


def name_blank_repeat_columns(rows: Lines) -> Lines:
    """The rows; right of a measured quantity, blank headings above numbers and its own again are its repeats.

    `angle [deg]` and a blank one become `angle 1 [deg]` and `angle 2 [deg]`.
    """
    if not rows:
        return rows
    (line, heading), *others = rows
    first, width = 0, max(filled_width(cells) for _, cells in rows)
    heading = [*heading, *[""] * (width - len(heading))]
    names = list(heading)
    for k in range(1, width):
        first_heading = read_heading(heading[first])
        content = [row[k] for _, row in others if k < len(row) and not is_missing(row[k])]
        numeric = bool(content) and all(map(is_quantity, content))
        roles = meaning_of(first_heading.name)[0], meaning_of_symbol(first_heading)[0]
        if heading[k] in ("", heading[first]) and numeric and "observable" in roles:
            for place in (first, k):
                unit = f" [{first_heading.unit}]" if first_heading.unit else ""
                names[place] = f"{first_heading.name} {place - first + 1}{unit}"
        else:
            first = k
    return [(line, names), *others]


def trim_rows(rows: Lines, name: str, faults: list[str]) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Rows as wide as the heading, without remarks behind it; of the others the first is a fault."""
    width = filled_width(rows[0][1]) if rows else 0
    rows = [(line, cells if has_digit(cells[width:]) else cells[:width]) for line, cells in rows]
    if wrong := [(line, cells) for line, cells in rows if not filled_width(cells) <= width <= len(cells)]:
        line, cells = wrong[0]
        more = f" ({len(wrong) - 1} rows more are not as wide)" if len(wrong) > 1 else ""
        faults.append(
            f"{name}: row {line} has {max(filled_width(cells), len(cells))} cells, the heading {width}{more};"
            " write one heading above every column, one table in a file, and text with separators in quotes"
        )
    yield from ((k, tuple(cells[:width])) for k, cells in rows if filled_width(cells) <= width <= len(cells))


def apply_number_laws(cells: Cells) -> Cells:
    """The cells without marks of significance; numbers of a law, such as sizes in phi, as what they mean."""
    columns, notes = list(map(list, zip(*(row for _, row in cells.rows), strict=True))), [*cells.notes]
    for column in columns:
        heading, content = read_heading(column[0]), column[1:]
        if has_word(heading.text, known_words()["roles"]["sd"]):
            content = [BRACKETED.sub(r"\1 ± \2", strip_brackets(cell).lstrip("± ")) for cell in content]
        value = heading.unit or meaning_of(heading.name)[0] not in ("group", "source", "remark", "unknown")
        matches = [MARKED.fullmatch(plain_cell(cell)) for cell in content] if value else []
        letters = {sign for match in matches if match for sign in match["mark"] + match["last"]}
        plain = content
        # of groups that do not differ, `27.9a`: an 'a' is among them, which is no unit, or two capital ones
        if "a" in letters or set() < letters <= {*"*†‡§"} or len(letters & set("ABCDEFGH")) > 1:
            pairs = zip(matches, content, strict=True)
            plain = [f"{m['value']}{m['sd'] or ''}" if m else cell for m, cell in pairs]
        column[1:] = [cell_in_column_unit(cell, heading, cells.decimal_comma) for cell in plain]
        conversions = known_words()["conversions"][heading.law or "mesh"] if column[1:] != plain else ()
        marks = (LEFT_OUT,) if plain != content else ()
        notes += [f"column '{heading.text}': {words}" for words in (*marks, *conversions)]
    rows = zip((line for line, _ in cells.rows), zip(*columns, strict=True), strict=True)
    return replace(cells, rows=tuple(rows), notes=tuple(notes))


def cell_in_column_unit(cell: str, heading: Heading, comma: bool) -> str:
    """A cell whose number follows a law, or is that of a sieve, as a number in the unit of its column.

    What cannot be turned gets the law as its unit, which nobody knows.
    """
    mark = "," if comma else "."
    sieve = SIEVE.fullmatch(plain_cell(cell))
    if sieve is not None and (heading.law == "mesh" or sieve["unit"]):
        sizes = [known_words()["sieves"].get(number, ("nan",))[0] for number in sieve.group(1, 2) if number]
        if "nan" not in sizes:
            return " to ".join(sorted(sizes, key=float)).replace(".", mark) + " mm"
    if not heading.law or cell_word(cell):
        return cell
    try:
        reading = read_cell(cell, comma)
        step = reading.reach if 0.0 < reading.reach < inf else STEP
        low, value, high = (apply_law(reading.value + x, reading.unit, heading) for x in (-step, 0.0, step))
    except (ValueError, ArithmeticError):
        return f"{cell} {heading.law}"
    if step == reading.reach:
        return f"{min(low, high):.9g} to {max(low, high):.9g}".replace(".", mark)
    sd = "" if isnan(reading.sd) else f" ± {abs(high - low) / (2.0 * STEP) * reading.sd:.6g}"
    return f"{'<' * (reading.reach < 0.0)}{'>' * (reading.reach > 0.0)}{value:.9g}{sd}".replace(".", mark)


def find_column_and_siblings(cells: Cells, text: str) -> tuple[list[int], list[int]]:
    """Place of the column that a user calls by its heading or name; places of its numbered siblings."""
    headings = {place: read_heading(each).name for place, each in enumerate(cells.heading) if each}
    plain = plain_words(text)
    itself = [k for k, name in headings.items() if plain in map(plain_words, (name, cells.heading[k]))][:1]
    common = plain_words(stem(headings[itself[0]] if itself else text))
    numbered = [k for k, name in headings.items() if stem(name) != name and plain_words(stem(name)) == common]
    return itself, numbered if not itself or itself[0] in numbered else []


def word_of_summary_row(cells: Cells, row: Sequence[str], conditions: Sequence[int]) -> str:
    """Word of a row that sums up others, those alike in all conditions, or all; empty for another row.

    Or one of a statistic, `F`, `LSD`, `Tukey HSD`: with fewer cells than others have, among rows that are
    numbered, or by a word that names nothing else; `slope` may be a site. Or one by which it does not count.
    """
    parts = ((cell, plain_words(part)) for cell in row for part in re.split(r"[,;:()–-]", cell))
    if out := [cell for cell, part in parts if part in known_words()["rows"]["excluded"]]:
        return out[0]
    odd = word_among_numbers(cells, row, conditions)
    label = odd or next(filter(None, row), "")
    words = {*re.findall(r"[^\W\d_]+2?", label.casefold())}
    filled = [sum(map(bool, r)) for _, r in cells.lines]
    fewer = sum(map(bool, row)) < sorted(filled)[len(filled) // 2]
    clear = max(map(len, words), default=0) > 2 and meaning_of(label)[0] != "condition"
    numbered = re.search(r"[^\W\d_]\d", label.casefold().replace("r2", ""))  # `DS1`
    is_statistic = words and words <= {*known_words()["rows"]["statistic"]} and not numbered
    if is_statistic and (fewer or clear or odd):
        return label
    texts = [each for each in row if not is_quantity(each)]  # not `30 min`
    at, cell = [row[k] for k in conditions], next((c for c in texts if is_summary_word(last_word(c))), "")
    rest = (each for _, each in cells.lines if last_word(cell) not in map(last_word, each))
    is_sum = cell in at or not all(at) or (cell and any([each[k] for k in conditions] == at for each in rest))
    is_mean = is_called_summary([label]) and (odd or is_mean_row(cells, row, conditions))
    return label if is_mean else cell if is_sum else ""


def word_among_numbers(cells: Cells, row: Sequence[str], conditions: Sequence[int]) -> str:
    """Cell of a row that is a word where most rows have a number, as `SD` among running numbers.

    Of a row without conditions of its own: blank ones, or those of the row above.
    """
    lines = [each for _, each in cells.lines]
    above = lines[max(lines.index(tuple(row)) - 1, 0)]
    for place, cell in enumerate(row if all(row[k] in ("", above[k]) for k in conditions) else ()):
        if not cell or is_quantity(cell) or has_digit(cell):
            continue
        if 3 * sum(is_quantity(each[place]) for each in lines if each[place]) > len(lines):
            return cell
    return ""


def is_mean_row(cells: Cells, row: Sequence[str], conditions: Sequence[int]) -> bool:
    """Whether a row has, in all conditions and in a result, the mean of some rows above not called so."""
    lines = [each for _, each in cells.lines]
    above = [each for each in lines[: lines.index(tuple(row))] if not is_called_summary(each)]
    *table, last = [[number_or_nan(cell, cells.decimal_comma) for cell in each] for each in (*above, row)]
    for k in range(2, len(table) + 1):
        columns = list(zip(*table[-k:], strict=True))
        alike = {c for c, x in enumerate(last) if isclose(fmean(columns[c]), x, rel_tol=0.01)}
        results = [c for c in alike - {*conditions} if len({*columns[c]}) > 1]
        if conditions and results and alike >= {*conditions}:
            return True
    return False


def laboratory_table_digest(table: Path) -> str:
    """Digest of the cells by which a laboratory's table is known again; empty where it is unreadable."""
    with suppress(BadInput):
        rows = read_table_cells(table, table.name, []).rows
        return content_digest(repr([cells for _, cells in rows]).encode())
    return ""
