"""Tables of trials: one line of JSON a case, compressed; `results/` holds one for each trial."""

import gzip
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from taichi_erosion.core.files import write_atomic

HERE = Path(__file__).parent
Row = dict[str, Any]  # set, case, sha256 of the truth, commit of the method, truth, difficulty, answer


def table_of(trial: str) -> Path:
    """Table of results of a trial."""
    return HERE / "results" / f"{trial}.jsonl.gz"


def read_rows(table: Path) -> list[Row]:
    """All rows; none where there is no table. A number that is none is None."""
    if not table.exists():
        return []
    with gzip.open(table, "rt", encoding="utf-8") as file:
        return [json.loads(line) for line in file]


def write_rows(table: Path, rows: Iterable[Row]) -> None:
    """Write a table; the same rows make the same bytes."""
    text = "".join(json.dumps(short(row), separators=(",", ":")) + "\n" for row in rows)
    table.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(table, gzip.compress(text.encode(), mtime=0))


def add_rows(trial: str, rows: list[Row]) -> None:
    """Rows of some sets in place of earlier ones of the same."""
    new = {row["set"] for row in rows}
    write_rows(table_of(trial), [*(r for r in read_rows(table_of(trial)) if r["set"] not in new), *rows])


def short(value: Any) -> Any:
    """The same with six significant digits."""
    if isinstance(value, dict):
        return {key: short(entry) for key, entry in value.items()}
    if isinstance(value, tuple | list):
        return [short(entry) for entry in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if abs(value) < float("inf") else None
    return value
