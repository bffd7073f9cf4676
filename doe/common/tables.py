"""Tables of a study: one dataclass a row, one field a column, as CSV."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import pandas as pd

from taichi_erosion.core.files import write_atomic

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    Record = TypeVar("Record", bound=DataclassInstance)


def write_table(
    path: Path, kind: type[Record], rows: Sequence[Record], digits: int = 7, none: str = ""
) -> None:
    """Write rows as CSV; a number that is none is an empty field, or `none`."""
    write_lines(path, list(map(asdict, rows)), digits, none, [f.name for f in fields(kind)])


def write_lines(
    path: Path,
    lines: Sequence[Mapping[str, Any]],
    digits: int = 7,
    none: str = "",
    heading: list[str] | None = None,
) -> None:
    """Write lines whose keys are the heading, as CSV."""
    table = pd.DataFrame(list(lines), columns=heading)
    text = table.to_csv(index=False, float_format=f"%.{digits}g", na_rep=none, lineterminator="\n")
    write_atomic(path, text.encode())


def read_table(path: Path, kind: type[Record]) -> list[Record]:
    """Rows of a table that `write_table` wrote; none where it has not been made yet."""
    kinds: dict[str, Any] = {f.name: f.type for f in fields(kind)}
    return [
        kind(**{k: nan if kinds[k] is float and not text else kinds[k](text) for k, text in line.items()})
        for line in lines_of(path)
    ]


def lines_of(path: Path) -> list[dict[str, str]]:
    """Lines of a CSV file as text; none where there is no file."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def update_table(
    path: Path, kind: type[Record], rows: Sequence[Record], key: Callable[[Record], Any], **form: Any
) -> None:
    """Write rows in place of those that stand there already under the same key; `form` is `write_table`'s."""
    done = {key(row) for row in rows}
    write_table(path, kind, [*(r for r in read_table(path, kind) if key(r) not in done), *rows], **form)
