"""Markdown tables, and numbers with their scatter."""

from collections.abc import Sequence
from math import isfinite


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Markdown table; the first column is left-aligned, the others are right-aligned."""
    rule = [":--", *("--:" for _ in header[1:])]
    return "".join("| " + " | ".join(row) + " |\n" for row in (header, rule, *rows))


def with_spread(value: float, sd: float, n: int) -> str:
    """`value ± sd (n)`, rounded to the second digit of sd; without sd for a single value."""
    if not isfinite(value):
        return "none"
    if n < 2 or not isfinite(sd):
        return f"{value:.4g} (1)"
    places = max(0, 1 - magnitude(sd))
    return f"{value:.{places}f} ± {sd:.{places}f} ({n})"


def with_scatter_of(value: float, scatter: float, signed: bool = False) -> str:
    """Number rounded to the second digit of its scatter; to four digits where that is not known."""
    sign = "+" if signed else ""
    if not isfinite(value):
        return "none"
    if not (isfinite(scatter) and scatter > 0.0):
        return f"{value:{sign}.4g}"
    places = 1 - magnitude(scatter)
    return f"{round(value, places) + 0.0:{sign}.{max(places, 0)}f}"


def magnitude(number: float) -> int:
    """Decimal exponent."""
    return int(f"{number:e}".partition("e")[2])
