"""Numbers as laboratories write them into cells: `31,2 ± 0,8`, `2 %`, `<0.02`, `> 40`, `20..25`, `1 250 µm`.

A file has one decimal mark. What has two readings, or is no number, is refused with its remedy.
"""

import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from math import inf, isfinite, nan

MISSING = set(
    "|-|--|–|—|/|.|?|*|na|n/a|nan|null|none|k.a.|k. a.|n.r.|s/d|n.a.|n. a.|n.b.|n. b.|n.g.".split("|")
)
MISSING |= {"not measured", "nicht gemessen", "missing", "fehlt", "nicht bestimmt", "not determined"}
MISSING |= {"non mesuré"}
UNSEEN = set("n.d.|n. d.|nd|n.n.|n. n.|bdl|b.d.l.|lod|<lod|< lod|<lq|u.n.g.|trace|spuren".split("|"))
UNSEEN |= {"not detected", "nicht nachweisbar", "below detection limit"}
NO_TRANSPORT = {"no transport", "no motion", "kein transport"}
WORDS = MISSING | UNSEEN | NO_TRANSPORT
GROUPED = r"\d{1,3}(?:[ '\u2019]\d{3})+(?:[.,]\d+)?"  # thousands set apart
NUMBER = rf"[+-]?(?:{GROUPED}|\d+(?:[.,]\d+)*|[.,]\d+)(?:[eE][+-]?\d{{1,3}})?"
UNIT = r"[^\W\d_%‰°][^\s±<>=;]*(?:[ /·*][^\s±<>=;]+)*|[%‰°][^\s±<>=;]*"
QUANTITY = re.compile(
    rf"(?P<limit>[<>]?)\s*(?P<number>{NUMBER})\s*(?P<unit>{UNIT})?"
    rf"(?:\s*(?:±|\+/-|\+-)\s*(?P<sd>{NUMBER})\s*(?P<sd_unit>{UNIT})?)?"
)
TO = r"\s*(?:\.\.\.?|…|\bto\b|\bbis\b)\s*"
INTERVAL = re.compile(rf"(?P<low>{NUMBER}){TO}(?P<high>{NUMBER})\s*(?P<unit>{UNIT})?")
RANGE = re.compile(rf"(?P<low>{NUMBER})(?:\s*[-–—]\s*|{TO})(?P<high>{NUMBER}).*")  # in any form
ONE_NUMBER = "is no single number; write the likeliest"  # of a condition, a scatter, a number of repeats
MONTH = r"(?:jan|feb|m[aä]r|mrz|apr|ma[iy]|jun|jul|aug|sep|o[ck]t|nov|de[cz])[a-zé]*\.?"
DATE = re.compile(
    r"\d{1,2}[./-]\d{1,2}[./-]\d{2,4}.*|\d{4}-\d{2}-\d{2}.*"
    rf"|\d{{1,2}}\.?[ -]?{MONTH}.*|{MONTH}[ -]\d{{2,4}}",
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
    """A cell in plain signs: digits of any script, spaces of any width, one kind of minus."""
    found = []
    for sign in text.strip():
        digit = unicodedata.decimal(sign, None)
        found.append(str(digit) if digit is not None else " " if sign.isspace() else sign)
    return "".join(found).translate(SIGNS)


def is_missing(cell: str) -> bool:
    """Whether a cell says that nothing was measured."""
    return plain_cell(cell).lower() in MISSING


def has_decimal_comma(cells: Iterable[str], separator: str) -> bool:
    """Whether the numbers of a table have decimal commas.

    Between columns that commas separate, groups of three digits behind a comma are thousands.
    """
    numbers = [match["number"] for cell in cells if (match := QUANTITY.fullmatch(plain_cell(cell)))]
    commas, points = (sum(mark in number for number in numbers) for mark in ",.")
    fractions = any(re.search(r",(?!\d{3}\b)", number) for number in numbers)
    return commas > points and (separator != "," or fractions)


def is_quantity(cell: str) -> bool:
    """Whether a cell holds a number, or says that it has none."""
    plain = plain_cell(cell)
    return bool(plain.lower() in WORDS or QUANTITY.fullmatch(plain) or INTERVAL.fullmatch(plain))


def read_cell(text: str, comma: bool, single: bool = False) -> CellNumber:
    """Number of a cell; raises CellFault. `single`: a limit or an interval is none."""
    plain = plain_cell(text)
    if plain.lower() in MISSING:
        return CellNumber()
    match, between, dated = (form.fullmatch(plain) for form in (QUANTITY, INTERVAL, DATE))
    if single and not dated and ((match and match["limit"]) or RANGE.fullmatch(plain)):
        raise CellFault(ONE_NUMBER)
    if between is not None:
        low, high = decimal(between["low"], comma), decimal(between["high"], comma)
        if not low < high:
            raise CellFault("is no interval: the first number must be below the second")
        return CellNumber(0.5 * (low + high), 0.5 * (high - low), unit=between["unit"] or "")
    if match is None or dated:
        raise CellFault(reason(plain))
    if match["sd_unit"] and match["sd_unit"] != match["unit"] and (match["unit"] or match["sd_unit"] == "%"):
        raise CellFault("has two units, of the value and its scatter; give the scatter a column of its own")
    reach = {"<": -inf, ">": inf}.get(match["limit"], 0.0)
    sd = decimal(match["sd"], comma) if match["sd"] else nan
    return CellNumber(decimal(match["number"], comma), reach, sd, match["unit"] or match["sd_unit"] or "")


def reason(plain: str) -> str:
    """Why a text is no number, and what to do."""
    if plain.startswith("#"):
        return "is an error of the spreadsheet; correct its formula and export the table again"
    if plain.lower() in UNSEEN:
        return "is not seen: leave the cell empty, or write '<' and the least value that the instrument sees"
    if DATE.fullmatch(plain):
        return "is a date; if the spreadsheet made it of a number, set the column to text and type it again"
    if re.search(r"\s*\(\s*(?:±\s*)?[\d.,]+\s*\)$", plain):
        return "write the scatter behind '±', or in a column of its own"
    between = RANGE.fullmatch(plain)
    if between is not None:
        ends = f"{between['low']}..{between['high']}"
        return f"is a range; write {ends} where the value lies between, or mean ± standard deviation"
    if re.fullmatch(r"[\d.,]+(?: [\d.,]+)+", plain):
        return "has a blank in the number, or is two numbers; write one"
    return "must be a number; words belong into a column of their own"


def decimal(number: str, comma: bool) -> float:
    """Value of a number; raises CellFault for one with the other mark, or with two readings."""
    digits = re.sub(r"(?<=\d)[ '\u2019](?=\d{3})", "", number)
    wrong, right = (".", ",") if comma else (",", ".")
    if wrong in digits:
        marks = "decimal commas" if comma else "decimal points"
        raise CellFault(f"has a '{wrong}', the other numbers of the file {marks}; no sign between thousands")
    if digits.count(right) > 1:
        raise CellFault(f"has two '{right}'; no sign between thousands")
    value = float(digits.replace(",", "."))
    if not isfinite(value):
        raise CellFault("must be a finite number")
    return value
