"""Numbers with their units and scatter, counts, and tables as a person reads them; needs no other module."""

from collections.abc import Sequence
from math import floor, isfinite, log10

PURE = ("", "1", "-")
LARGEST = 1e6  # number from which on one is written with an exponent


def heading(name: str, unit: str) -> str:
    """`diameter [um]`; a pure number has its name alone."""
    return name if unit in PURE else f"{name} [{unit}]"


def with_unit(text: str, unit: str) -> str:
    """Number and unit; a pure number stands alone."""
    return text if unit in PURE else f"{text} {unit}"


def plain(value: float, digits: int = 3) -> str:
    """Number in at most so many significant digits; `12300`, and an exponent from LARGEST on."""
    text = f"{value:.{digits}g}"
    if "e" not in text or not 1.0 <= abs(value) < LARGEST:
        return text
    return f"{round(value, digits - 1 - floor(log10(abs(value)))):.0f}"


def round_number(value: float, digits: int = 6) -> float:
    """A number without meaningless digits."""
    return float(f"{value:.{digits}g}")


def toml_key(name: str) -> str:
    """A name as a key of TOML, in quotes where it has letters that are not ASCII."""
    return name if name.isascii() else f'"{name}"'


def count_noun(count: int, noun: str) -> str:
    """`1 row`, `17 rows`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def value_and_sd_text(value: float, sd: float, n: int) -> str:
    """`value ± sd (n)`, rounded to the second digit of sd; without sd for a single value."""
    if not isfinite(value):
        return "none"
    if n < 2 or not isfinite(sd):
        return f"{value:.4g} (1)"
    places = max(0, 1 - decimal_exponent(sd))
    return f"{value:.{places}f} ± {sd:.{places}f} ({n})"


def round_to_scatter(value: float, scatter: float, with_sign: bool = False) -> str:
    """Number rounded to the second digit of its scatter; to four digits where that is not known."""
    sign = "+" if with_sign else ""
    if not isfinite(value):
        return "none"
    if not (isfinite(scatter) and scatter > 0.0):
        return f"{value:{sign}.4g}"
    places = 1 - decimal_exponent(scatter)
    return f"{round(value, places) + 0.0:{sign}.{max(places, 0)}f}"


def decimal_exponent(number: float) -> int:
    return int(f"{number:e}".partition("e")[2])


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Markdown table; the first column is left-aligned, the others are right-aligned."""
    rule = [":--", *("--:" for _ in header[1:])]
    return "".join("| " + " | ".join(row) + " |\n" for row in (header, rule, *rows))
