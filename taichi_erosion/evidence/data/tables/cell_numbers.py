"""Numbers as laboratories write them into cells: `31,2 ± 0,8`, `2 %`, `<0.02`, `> 40`, `20..25`, `1 250 µm`.

A file has one decimal mark. What has two readings, or is no number, is refused with its remedy.
"""

import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite
from typing import Literal

MISSING = ("", "-", "--", "–", "—", "/", ".", "?", "*", "na", "n/a", "nan", "null", "none", "k.a.", "k. a.")
MISSING += ("n.r.", "s/d", "not measured", "nicht gemessen", "missing", "fehlt", "n.a.", "n. a.", "n.b.")
MISSING += ("n. b.", "n.g.", "nicht bestimmt", "not determined", "non mesuré")
UNSEEN = ("n.d.", "n. d.", "nd", "n.n.", "n. n.", "bdl", "b.d.l.", "lod", "<lod", "< lod", "<lq", "u.n.g.")
UNSEEN += ("not detected", "nicht nachweisbar", "below detection limit", "trace", "spuren")
NO_TRANSPORT = ("no transport", "no motion", "kein transport")
GROUPED = r"\d{1,3}(?:[ '\u2019]\d{3})+(?:[.,]\d+)?"  # thousands set apart
NUMBER = rf"[+-]?(?:{GROUPED}|\d+(?:[.,]\d+)*|[.,]\d+)(?:[eE][+-]?\d{{1,3}})?"
UNIT = r"[^\W\d_%‰°][^\s±<>=;]*(?:[ /·*][^\s±<>=;]+)*|[%‰°][^\s±<>=;]*"
QUANTITY = re.compile(
    rf"(?P<limit>[<>≤≥]?)\s*(?P<number>{NUMBER})\s*(?P<unit>{UNIT})?"
    rf"(?:\s*(?:±|\+/-|\+-)\s*(?P<sd>{NUMBER})\s*(?P<sd_unit>{UNIT})?)?"
)
INTERVAL = re.compile(
    rf"(?P<low>{NUMBER})\s*(?:\.\.\.?|…|\bto\b|\bbis\b)\s*(?P<high>{NUMBER})\s*(?P<unit>{UNIT})?"
)
RANGE = re.compile(
    rf"(?P<low>{NUMBER})\s*(?:-|–|—|\.\.\.?|…|\bto\b|\bbis\b)\s*(?P<high>{NUMBER}).*"
)  # in any form
ONE_NUMBER = "is no single number; write the likeliest"  # of a condition, a scatter, a number of repeats
MONTH = r"(?:jan|feb|m[aä]r|mrz|apr|ma[iy]|jun|jul|aug|sep|o[ck]t|nov|de[cz])[a-zé]*\.?"
DATES = (
    r"\d{1,2}[./-]\d{1,2}[./-]\d{2,4}.*",
    r"\d{4}-\d{2}-\d{2}.*",
    rf"\d{{1,2}}\.?[ -]?{MONTH}.*",
    rf"{MONTH}[ -]\d{{2,4}}",
)
DATE = re.compile("|".join(DATES), re.IGNORECASE)
SPREAD = re.compile(r"\s*\(\s*(?:±\s*)?[\d.,]+\s*\)$")
LOOK_ALIKES = str.maketrans("OoОоlI|SBZ", "0000111582")  # letters typed for digits, two of them Cyrillic
SLIPPED = re.compile(  # a number with such letters: among digits, before a mark, or O and l at the end
    r"[+-]?(?=[^\d]*\d)(?:(?:[OoОоlI|](?=\d*[.,]\d)|\d)"
    r"(?:[\dOoОоlI|.,]|[SBZ](?=[\d.,]))*|[OoОоlI|][.,](?:[\dOoОоlI|]|[SBZ](?=\d))+)(?![^\W\d_])"
)
PARTS = re.compile(r"(\s*(?:±|\+/-|\+-|[<>])\s*)")  # a value, its limit, its scatter
ABOUT = re.compile(r"(?:~|≈|∼|(?:ca|approx|circa|etwa|about)\b\.?)\s*|\s*(?:[*†‡?!#'´`]+|[.,;:])$")


class CellFault(ValueError):
    """A cell that cannot be used: reason and remedy."""


@dataclass(frozen=True)
class CellNumber:
    """What a cell says; numbers as text with a decimal point, so that no digit is lost."""

    value: str  # empty: nothing was measured
    limit: Literal["", "<", ">"] = ""
    unit: str = ""  # as written behind the number
    sd: str = ""
    upper: str = ""  # end of an interval that begins at `value`


def plain_cell(text: str) -> str:
    """A cell in plain signs: digits of any script, spaces of any width, one kind of minus."""
    found = []
    for sign in text.strip():
        digit = unicodedata.decimal(sign, None)
        found.append(str(digit) if digit is not None else " " if sign.isspace() else sign)
    plain = "".join(found).replace("\N{MINUS SIGN}", "-").replace("\N{ARABIC DECIMAL SEPARATOR}", ".")
    return plain.replace("\N{LESS-THAN OR EQUAL TO}", "<").replace("\N{GREATER-THAN OR EQUAL TO}", ">")


def has_decimal_comma(cells: Iterable[str], separator: str) -> bool:
    """Whether the numbers of a table have decimal commas.

    Between columns that commas separate, groups of three digits behind a comma are thousands.
    """
    commas, points, fractions = 0, 0, 0
    for cell in cells:
        match = QUANTITY.fullmatch(plain_cell(cell))
        if match is not None:
            commas += "," in match["number"]
            points += "." in match["number"]
            fractions += re.search(r",(?!\d{3}\b)", match["number"]) is not None
    return commas > points and (separator != "," or fractions > 0)


def is_quantity(cell: str) -> bool:
    """Whether a cell holds a number, a misprint of one, or says that it has none."""
    plain = plain_cell(cell)
    known = plain.lower() in MISSING + UNSEEN + NO_TRANSPORT
    if known or any(form.fullmatch(plain) for form in (QUANTITY, INTERVAL)):
        return True
    return likely_number(plain) is not None


def likely_number(plain: str) -> str | None:
    """Number that a misprinted cell may mean, `70,3` for `7O,3`; None for a number, and for any other text.

    Looked for: letters that look like digits, marks that stand twice, blanks about a mark, footnote marks,
    and words such as `ca.`; nothing is converted, the reading is for the message.
    """
    bare = ABOUT.sub("", plain)
    known = bare.lower() in MISSING + UNSEEN + NO_TRANSPORT or DATE.fullmatch(bare)
    if known or (QUANTITY.fullmatch(plain) and not letters_in_number(plain)):
        return None
    bare = re.sub(r"([.,])(?!\.)[.,](?=\d)", r"\1", re.sub(r"(?<=\d)\s*([.,])\s*(?=\d)", r"\1", bare))
    parts = [with_digits(part) for part in PARTS.split(bare)]
    found = "".join(parts)
    return found if found != plain and QUANTITY.fullmatch(found) else None


def misprint(likely: str) -> str:
    """What is told of a misprinted cell; `likely` is the number that it may mean."""
    return f"is nearly a number: a misprint of '{likely}'? correct the cell"


def letters_in_number(plain: str) -> bool:
    """Whether letters that look like digits stand in a number; `3 l` and `3 mm` are numbers with a unit."""
    return any(with_digits(part) != part for part in PARTS.split(plain))


def with_digits(part: str) -> str:
    """A number with digits in place of the letters that look like them; any other text as it stands."""
    found = SLIPPED.match(part)
    return part if found is None else found[0].translate(LOOK_ALIKES) + part[found.end() :]


def read_cell(text: str, comma: bool) -> CellNumber:
    """Number of a cell; raises CellFault."""
    plain = plain_cell(text)
    if plain.lower() in MISSING:
        return CellNumber("")
    between = INTERVAL.fullmatch(plain)
    if between is not None:
        return interval(between, comma)
    match, likely = QUANTITY.fullmatch(plain), likely_number(plain)
    if likely is not None:
        raise CellFault(misprint(likely))
    if match is None or DATE.fullmatch(plain):
        raise CellFault(reason(plain))
    if match["sd"] and match["sd_unit"] and match["sd_unit"] != (match["unit"] or match["sd_unit"]):
        raise CellFault("the value and its scatter have two units; give the scatter a column of its own")
    if match["sd_unit"] == "%" and match["unit"] != "%":
        raise CellFault("is the scatter a share of the value? give it a column of its own, in its unit")
    limit = match["limit"]
    assert limit in ("", "<", ">")
    sd = decimal(match["sd"], comma) if match["sd"] else ""
    return CellNumber(decimal(match["number"], comma), limit, match["unit"] or match["sd_unit"] or "", sd)


def interval(match: re.Match[str], comma: bool) -> CellNumber:
    """Both ends of an interval; raises CellFault where they are not in order."""
    low, high = decimal(match["low"], comma), decimal(match["high"], comma)
    if not float(low) < float(high):
        raise CellFault("is an interval whose first number is not below its second")
    return CellNumber(low, "", match["unit"] or "", upper=high)


def is_range(plain: str) -> bool:
    """Whether a text gives two numbers as the ends of a range, in the form of an interval or in any other."""
    return RANGE.fullmatch(plain) is not None and DATE.fullmatch(plain) is None


def reason(plain: str, ranges: bool = True) -> str:
    """Why a text is no number, and what to do; `ranges`: whether an interval may stand in its place."""
    if plain.startswith("#"):
        return "is an error of the spreadsheet; correct its formula and export the table again"
    if plain.lower() in UNSEEN:
        return (
            "is not measured, or not seen: leave the cell empty, or write '<' and the least value that the "
            "instrument sees"
        )
    if DATE.fullmatch(plain):
        return "is a date; if the spreadsheet made it of a number, set the column to text and type it again"
    if SPREAD.search(plain):
        return "write the scatter behind '±', or in a column of its own"
    between = RANGE.fullmatch(plain)
    if between is not None and not ranges:
        return ONE_NUMBER
    if between is not None:
        interval = f"{between['low']}..{between['high']}"
        return f"is a range; write {interval} where the value lies between, or mean ± standard deviation"
    if re.fullmatch(r"[\d.,]+(?: [\d.,]+)+", plain):
        return "has a blank in the number, or is two numbers; write one"
    return "must be a number; words belong into a column of their own"


def decimal(number: str, comma: bool) -> str:
    """A number with a decimal point; raises CellFault for one with the other mark, or with two readings."""
    digits = re.sub(r"(?<=\d)[ '\u2019](?=\d{3})", "", number)
    wrong, right = (".", ",") if comma else (",", ".")
    if wrong in digits:
        marks = "decimal commas" if comma else "decimal points"
        raise CellFault(f"has a '{wrong}', the other numbers of the file {marks}; no sign between thousands")
    if digits.count(right) > 1:
        raise CellFault(f"has two '{right}'; no sign between thousands")
    plain = digits.replace(",", ".")
    if not isfinite(float(plain)):
        raise CellFault("is too large")
    return plain
