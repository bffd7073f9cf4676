"""Tables of a study: one dataclass a row, one field a column, as CSV."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import astuple, fields
from io import StringIO
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from taichi_erosion.core.files import write_atomic

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    Record = TypeVar("Record", bound=DataclassInstance)


def write_table(path: Path, kind: type[Record], rows: Sequence[Record], digits: int = 7) -> None:
    """Write rows as CSV; a number that is none is an empty field."""
    heading = [f.name for f in fields(kind)]
    lines = [heading, *([cell(value, digits) for value in astuple(row)] for row in rows)]
    page = StringIO(newline="")
    csv.writer(page, lineterminator="\n").writerows(lines)
    write_atomic(path, page.getvalue().encode())


def read_table(path: Path, kind: type[Record]) -> list[Record]:
    """Rows of a table that `write_table` wrote."""
    kinds = {f.name: f.type for f in fields(kind)}
    with path.open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    return [kind(**{name: parsed(kinds[name], text) for name, text in line.items()}) for line in lines]


def cell(value: object, digits: int) -> str:
    """A value as the table holds it."""
    if isinstance(value, float):
        return "" if value != value else f"{value:.{digits}g}"
    return str(value)


def parsed(kind: Any, text: str) -> Any:
    """A cell as its field wants it."""
    return nan if kind is float and not text else kind(text)
