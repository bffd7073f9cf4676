"""Numbers, units and counts as a person reads them; needs no other module."""

from math import floor, isfinite, log10

PURE = ("", "1", "-")
READABLE = (1e-4, 1e6)  # sizes of numbers that are written without an exponent


def heading(name: str, unit: str) -> str:
    """`diameter [um]`; a pure number has its name alone."""
    return name if unit in PURE else f"{name} [{unit}]"


def with_unit(text: str, unit: str) -> str:
    """Number and unit; a pure number stands alone."""
    return text if unit in PURE else f"{text} {unit}"


def plain(value: float, digits: int = 3) -> str:
    """Number in at most so many significant digits, without an exponent where it is readable without."""
    text = f"{value:.{digits}g}"
    return short(value, digits) if "e" in text and isfinite(value) else text


def short(value: float, digits: int = 2) -> str:
    """Number in significant digits, zeros at its end too; with an exponent where it is unreadable without."""
    if value == 0.0 or not isfinite(value):
        return f"{value:g}"
    places = digits - 1 - floor(log10(abs(value)))
    text = f"{value:.{max(places, 0)}f}" if places > 0 else f"{round(value, places):.0f}"
    low, high = READABLE
    return text if low <= abs(value) < high else f"{value:.{digits}g}"


def counted(count: int, noun: str) -> str:
    """`1 row`, `17 rows`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
