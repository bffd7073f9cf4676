"""Numbers in cells as laboratories write them: `31,2 ± 0,8`, `2 %`, `<0.02`, `> 40`, `20..25`, `1 250 µm`.

A file has one decimal mark. What has two readings, or is no number, is refused with its remedy.
"""

import re
import unicodedata
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from math import inf, isfinite, isnan, nan

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene.schema.units import UnknownUnit, parse_unit, scale_between
from taichi_erosion.tables.headings import known_words, plain_words, unit_in

GROUPED = r"\d{1,3}(?:[ '\u2019]\d{3})+(?:[.,]\d+)?"  # thousands set apart
NUMBER = rf"[+-]?(?:{GROUPED}|\d+(?:[.,]\d+)*|[.,]\d+)(?:[eE][+-]?\d{{1,3}})?"
UNIT = r"[^\W\d_%‰°][^\s±<>=;]*(?:[ /·*][^\s±<>=;]+)*|[%‰°][^\s±<>=;]*"
QUANTITY = re.compile(
    rf"(?P<limit>[<>]?)\s*(?P<number>{NUMBER})\s*(?P<unit>{UNIT})?"
    rf"(?:\s*(?:±|\+/-|\+-)\s*(?P<sd>{NUMBER})\s*(?P<sd_unit>{UNIT})?)?"
)
TO = r"\s*(?P<to>\.\.\.?|…|\bto\b|\bbis\b|\bà\b|[-–—~～])\s*"
LOW = rf"(?P<low>{NUMBER})(?:\s*[^\W\d_]{{1,3}}(?=\s*[-–—]))?"
INTERVAL = re.compile(rf"{LOW}{TO}(?P<high>{NUMBER})\s*(?P<unit>{UNIT})?")
BASE = r"[x×X*·⋅∙]\s*10\s*(?:(?:\^|\*\*)\s*\(?|\(?(?=[-+]))"  # of a power of ten
POWER = re.compile(rf"(?<=\d)\s*(?:{BASE}([-+]?\d+)\)?|[eE]\s*([-+]\d+))(?!\d)")
RAISED = re.compile(r"[⁺⁻]?[⁰¹²³⁴-⁹]+")
RAISED_POINT = re.compile(r"(?<=\d)[·‧](?!10\d)(?=\d)")
MINUTES = re.compile(r"(\d+)\s*[°º]\s*([0-5]?\d)\s*['′’]")  # of an angle
IN_BRACKETS = re.compile(r"\((\s*(?:±|\+/-|\+-)[^()]*)\)")  # scatter
UP_TO = re.compile(r"^(?:bis(?: zu)?|up to|jusqu'à|hasta|fino a|até|до)\s+(?=\d)", re.IGNORECASE)  # a limit
MONTH = r"(?:jan|feb|m[aä]r|mrz|apr|ma[iy]|jun|jul|aug|sep|o[ck]t|nov|de[cz])[a-zé]*\.?"
ISO_MONTH = r"(?:19|20)\d\d-(?:0\d|1[0-2])"
DATE = re.compile(
    rf"(?i)\d{{1,4}}([./-])\d{{1,2}}\1\d{{2,4}}.*|{ISO_MONTH}|\d{{1,2}}\.?[ -]?{MONTH}.*|{MONTH}[ -]\d{{2,4}}"
)
DAYS = ("%Y-%m-%d", "%Y/%m/%d", "%d.%m.%Y", "%d.%m.%y", "%d/%m/%Y", "%m/%d/%Y", "%d/%m/%y", "%m/%d/%y")
DAYS += ("%Y年%m月%d日", "%d-%b-%Y", "%d %b %Y", "%d %B %Y")
TIME = re.compile(r"(?:[ T]\d{1,2}:\d\d(?::\d\d)?Z?)?$")  # behind a date
THOUSANDS = re.compile(r"[1-9]\d{0,2}[.,]\d{3}")
DITTO = re.compile(
    r"""["″〃”“„]|['’′]{2}|[-–—]+ ?["„”“″] ?[-–—]+|ditto|idem|dito|do\.|dto\.|id\.|↓|同上|то же""",
    re.IGNORECASE,
)
SIGNS = str.maketrans({"\N{MINUS SIGN}": "-", "\N{ARABIC DECIMAL SEPARATOR}": ".", "≤": "<", "≥": ">"})


class CellFault(ValueError):
    """A cell that cannot be used: reason and remedy."""


@dataclass(frozen=True)
class CellNumber:
    """What a cell says."""

    value: float = nan  # the limit of a limit, the middle of an interval; NaN: nothing was measured
    reach: float = 0.0  # 0; of '<' -inf, of '>' +inf, h of an interval from value - h to value + h
    sd: float = nan  # behind ±
    unit: str = ""  # as written behind the number


def plain_cell(text: str) -> str:
    """A cell with one kind of minus, point and limits, powers of ten as `5.7e-1`, and minutes as degrees."""
    bare = IN_BRACKETS.sub(r"\1", text.strip())
    raised = RAISED.sub(lambda power: f"^{unicodedata.normalize('NFKC', power[0])}", bare)
    powers = POWER.sub(lambda power: f"e{power[1] or power[2]}", UP_TO.sub("<", raised.translate(SIGNS)))
    degrees = MINUTES.sub(lambda angle: f"{int(angle[1]) + int(angle[2]) / 60.0:.5g}°", powers)
    return RAISED_POINT.sub(".", degrees)


def cell_word(cell: str) -> str:
    """What the words of a cell say, `missing`, `unseen` or `no_transport`; empty for other words."""
    plain = plain_words(cell)
    return next((meaning for meaning, words in known_words()["cells"].items() if plain in words), "")


def is_missing(cell: str) -> bool:
    """Whether a cell says that nothing was measured."""
    return cell_word(cell) == "missing"


def has_decimal_comma(cells: Iterable[str], separator: str) -> bool:
    """Whether the numbers of a table have decimal commas.

    Between columns that commas separate, groups of three digits behind a comma are thousands.
    """
    numbers = [match["number"] for cell in cells if (match := QUANTITY.fullmatch(plain_cell(cell)))]
    commas, points = (sum(number.count(mark) == 1 for number in numbers) for mark in ",.")
    return commas > points and (separator != "," or any(re.search(r",(?!\d{3}\b)", n) for n in numbers))


def number_with_two_readings(cells: Iterable[str]) -> str:
    """A number such as `1.500` among `250` and `500`, which seems to have a mark between thousands; or empty.

    Where all marks of a column can be such, and the numbers lie nearer to each other with them.
    """
    texts = [m["number"] for cell in cells if (m := QUANTITY.fullmatch(plain_cell(cell))) and not m["unit"]]
    marked = [text for text in texts if not text.isdigit()]
    whole = [float(text) for text in texts if text.isdigit() and len(text) > 1]
    if not (whole and marked and all(map(THOUSANDS.fullmatch, marked))):
        return ""
    readings = [[*whole, *(float(re.sub("[.,]", mark, text)) for text in marked)] for mark in (".", "")]
    spread, other = (max(numbers) / min(numbers) for numbers in readings)
    return marked[0] if other < spread else ""


def is_quantity(cell: str) -> bool:
    """Whether a cell holds a number, or says that it has none."""
    return bool(cell_word(cell) or any(kind.fullmatch(plain_cell(cell)) for kind in (QUANTITY, INTERVAL)))


def cells_with_dittos(above: Sequence[str], cells: Sequence[str]) -> tuple[str, ...]:
    """Cells of a row, with that above in place of a ditto mark."""
    return tuple(up if DITTO.fullmatch(cell) else cell for up, cell in zip(above, cells, strict=True))


def read_cell(text: str, comma: bool, single: bool = False, middle: bool = False) -> CellNumber:
    """Number of a cell; raises CellFault. `single`: a limit is none, and an interval at most its `middle`."""
    plain = plain_cell(text)
    if is_missing(plain):
        return CellNumber()
    match, between = QUANTITY.fullmatch(plain), INTERVAL.fullmatch(plain)
    if DATE.fullmatch(plain) or not (match or between):
        raise CellFault(reason(plain))
    if between and (match is None or unit_in(match["unit"] or "1") is None):  # `5e-3` is one number
        if single and not middle:
            raise CellFault("is no single number; write the likeliest")
        return middle_of_interval(between, comma)
    assert match is not None
    if single and match["limit"]:
        raise CellFault("is no single number; write the likeliest")
    if match["sd_unit"] and match["sd_unit"] != match["unit"] and (match["unit"] or match["sd_unit"] == "%"):
        raise CellFault("has two units, of the value and its scatter; give the scatter a column of its own")
    reach = {"<": -inf, ">": inf}.get(match["limit"], 0.0)
    sd = decimal_value(match["sd"], comma) if match["sd"] else nan
    unit = match["unit"] or match["sd_unit"] or ""
    return CellNumber(decimal_value(match["number"], comma), reach, sd, unit_in(unit) or unit)


def number_or_nan(cell: str, comma: bool) -> float:
    """Number of a cell; NaN where it holds none."""
    try:
        return read_cell(cell, comma).value
    except CellFault:
        return nan


def middle_of_interval(between: re.Match[str], comma: bool) -> CellNumber:
    """Middle and half width of an interval; of a class of sizes, `0.43-0.25 mm`, the coarse end may lead."""
    low, high = (decimal_value(between[end], comma) for end in ("low", "high"))
    if between["to"] in "-–—":
        low, high = min(low, high), max(low, high)
    if not low < high:
        raise CellFault("is no interval: the first number must be below the second")
    return CellNumber(0.5 * (low + high), 0.5 * (high - low), unit=between["unit"] or "")


def days_since_first(texts: Sequence[str]) -> list[int]:
    """Days of dates since the first of them; empty where they are none, or can be read in two ways."""
    readings = list[list[datetime]]()
    for form in DAYS:
        with suppress(ValueError):
            readings.append([datetime.strptime(TIME.sub("", text, 1), form) for text in texts])
    return [(each - min(readings[0])).days for each in readings[0]] if len(readings) == 1 else []


def reason(plain: str) -> str:
    """Why a text is no number, and what to do."""
    if cell_word(plain) == "unseen":
        return "is not seen: leave the cell empty, or write '<' and the least value that the instrument sees"
    if DATE.fullmatch(plain):
        return "is a date; if the spreadsheet made it of a number, set the column to text and type it again"
    if re.match(r"[~≈∼?(]|(?:ca|c|approx|about|etwa|rund|env|um)\b", plain, re.I) or plain.endswith("?"):
        return "is no certain number: write the number alone, and behind ± how well it is known"
    if re.match(rf"{NUMBER} ?[(\[]", plain):
        return "has a bracket behind it: write the number alone, or with the sd of single repeats, 31.2 ± 0.8"
    return "must be a number (a measured one also 31.2 ± 0.8, <0.02 or 20..25); words go to another column"


def decimal_value(number: str, comma: bool) -> float:
    """Value of a number; raises CellFault for one with the other mark, or with two readings."""
    digits = re.sub(r"(?<=\d)[ '\u2019](?=\d{3})", "", number)
    wrong, right, marks = (".", ",", "decimal commas") if comma else (",", ".", "decimal points")
    if wrong in digits:
        raise CellFault(f"has a '{wrong}', the other numbers of the file {marks}; no sign between thousands")
    if digits.count(right) > 1:
        raise CellFault(f"has two '{right}'; no sign between thousands")
    value = float(digits.replace(",", "."))
    if not isfinite(value):
        raise CellFault("must be a finite number")
    return value


def stated_number(text: str, unit: str, name: str, example: str) -> float:
    """A number with its unit as the user states it, `0.03 mm`, in another unit; raises BadInput."""
    cell, scale = CellNumber(), None
    with suppress(CellFault, UnknownUnit):
        cell = read_cell(text.replace(",", "."), comma=False, single=True)
        scale = scale_between(cell.unit, parse_unit(unit))
    if scale is None or isnan(cell.value):
        raise BadInput(f"{name} '{text}': write a number and its unit, such as '{example}'")
    return scale.to_use(cell.value)
