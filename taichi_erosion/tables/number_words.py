"""Numbers, units and counts as a person reads them; needs no other module."""

from collections.abc import Iterable
from math import floor, log10

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


def count_noun(count: int, noun: str) -> str:
    """`1 row`, `17 rows`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def set_up_name(conditions: Iterable[float]) -> str:
    """Name of a set-up that has no other than its conditions; digests of tables rest on it."""
    return ", ".join(f"{value:g}" for value in conditions)
