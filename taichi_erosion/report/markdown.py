"""A page of docs whose tables come from files.

What stands between the marks `<!-- table: NAME -->` and `<!-- end -->` is written by a function,
the rest by hand.
"""

import re
from collections.abc import Mapping, Sequence
from math import isfinite

MARKED = re.compile(
    r"(?P<begin><!-- table: (?P<name>[\w ]+) -->\n)(?P<table>.*?)(?P<end><!-- end -->)", re.DOTALL
)


def fill_tables(page: str, tables: Mapping[str, str]) -> str:
    """The page with every marked place filled; marks and tables must answer each other."""
    marks = [found["name"] for found in MARKED.finditer(page)]
    if sorted(marks) != sorted(tables):
        raise ValueError(f"the page marks {sorted(marks)}, there are {sorted(tables)}")
    return MARKED.sub(lambda found: found["begin"] + tables[found["name"]] + found["end"], page)


def fill_table(page: str, name: str, table: str) -> str:
    """The page with one of its marked places filled, which must be there; the others stay."""
    others = {found["name"]: found["table"] for found in MARKED.finditer(page)}
    return fill_tables(page, others | {name: table})


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Markdown table, first column to the left, the rest to the right."""
    rule = [":--", *("--:" for _ in header[1:])]
    return "".join("| " + " | ".join(row) + " |\n" for row in (header, rule, *rows))


def with_spread(value: float, sd: float, n: int, digits: int = 2) -> str:
    """`value +- sd (n)`, cut at the second figure of the spread; a single value has none."""
    if not isfinite(value):
        return "none"
    if n < 2 or not isfinite(sd):
        return f"{value:.4g} (1)"
    places = max(0, digits - 1 - magnitude(sd))
    return f"{value:.{places}f} ± {sd:.{places}f} ({n})"


def magnitude(number: float) -> int:
    """Power of ten of the leading digit."""
    return int(f"{number:e}".partition("e")[2])
