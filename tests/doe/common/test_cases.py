"""Cases of studies: their tables are complete and come back from a file, a case is one command."""

import csv
import json
import subprocess
from dataclasses import fields
from math import isfinite, nan
from pathlib import Path
from typing import Any

import pytest

from doe.common.cases import GUARDED, STOPPED, Case, Row, command, read_rows, settings, simulate, write_rows
from doe.lab_c import page as lab_c
from taichi_erosion.core.errors import BadInput
from taichi_erosion.report.markdown import fill_tables, markdown_table

ROOT = Path(__file__).parents[3]
TABLES = {name: ROOT / "doe" / name / "results.csv" for name in ("lab_c", "repose_sensitivity")}


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES.keys())
def test_every_row_carries_value_unit_spread_seeds_hash_command_and_versions(table):
    with table.open(encoding="utf-8", newline="") as file:
        assert csv.DictReader(file).fieldnames == [field.name for field in fields(Row)]
    for row in (rows := read_rows(table)):
        assert isfinite(row.sd) == (row.n > 1)
        if row.observable == STOPPED:
            continue
        assert row.unit
        assert row.n >= 1 or row.note, "an observable without a value says why"
        assert len(row.hash) == 12
        assert row.time_step > 0.0
        assert row.grains > 0
        assert "taichi" in row.versions or "Update" in row.versions
        assert row.command
    assert any(row.observable != STOPPED for row in rows)


def test_both_diameters_are_compared_in_every_observable_with_six_seeds():
    rows = [row for row in read_rows(TABLES["lab_c"]) if row.group == lab_c.MAIN]
    wanted = lab_c.read_laboratory(ROOT / "doe" / "lab_c" / "laboratory.csv")
    assert {(row.observable, lab_c.DIAMETERS[row.label]) for row in rows} == set(wanted)
    assert all(row.n >= 6 for row in rows)


def a_row(**changes: object) -> Row:
    values = {"value": 1.5, "sd": 0.2, "n": 4, "unit": "m", "note": 'a comma, a "quote"'} | changes
    rest = {f.name: "" if f.type is str else f.type(0) for f in fields(Row) if f.name not in values}
    return Row(**(rest | values))


def test_a_table_comes_back_from_its_file_unchanged(tmp_path):
    rows = [a_row(), a_row(sd=nan, n=1, note="")]
    write_rows(tmp_path / "t.csv", rows)
    back = read_rows(tmp_path / "t.csv")
    assert repr(back) == repr(rows)  # NaN differs from itself, its text does not


def test_a_case_is_the_command_that_repeats_it():
    case = Case("g", "l", settings("grains.count=10"), 2)
    typed = "run s.toml --set grains.count=10 --replicas 2 --threads 1 --no-record --json"
    assert " ".join(command("s.toml", case)) == typed


def a_document(stops: list[str | None], **found: float) -> dict[str, Any]:
    """What `run --json` prints of one observable, as far as a table holds it."""
    return {
        "limits": {"time_step": 1e-5, "time_step_over_rayleigh": 0.2},
        "replicas": [{"stopped": stop} for stop in stops],
        "measures": {"repose_angle": {"value": 30.0, "sd": 2.0, "unit": "deg", "notes": []} | found},
        "hash": "0" * 12,
        "seed": 1,
        "resolved": {"grains": {"count": 10}},
        "wall_s": 1.0,
        "versions": {},
    }


def ended(monkeypatch: pytest.MonkeyPatch, code: int, out: str) -> None:
    """Let every command end with a code and what it printed."""
    done = subprocess.CompletedProcess((), code, out, "stopped: overlap")
    monkeypatch.setattr(subprocess, "run", lambda *words, **options: done)


SOME_STOPPED = json.dumps(a_document([None, "overlap"], n=1))


@pytest.mark.parametrize(
    ("out", "row"),
    [
        (SOME_STOPPED, ("repose_angle", 1, "1 seeds stopped: overlap")),
        ("", (STOPPED, 0, "stopped: overlap")),  # all seeds
    ],
)
def test_a_case_of_which_a_guard_stopped_seeds_is_a_row_that_says_why(monkeypatch, out, row):
    ended(monkeypatch, GUARDED, out)
    (found,) = simulate("s.toml", Case("g", "l", ()))
    assert (found.observable, found.n, found.note) == row
    assert found.n == 0 or found.value == 30.0


def test_a_case_that_is_refused_ends_the_study(monkeypatch):
    ended(monkeypatch, 2, "")
    with pytest.raises(BadInput, match="stopped: overlap"):
        simulate("s.toml", Case("g", "l", ()))


def test_a_mark_without_a_table_is_noticed():
    page = "before\n<!-- table: a -->\nold\n<!-- end -->\nafter\n"
    assert fill_tables(page, {"a": markdown_table(("x",), [("1",)])}).count("| 1 |") == 1
    with pytest.raises(ValueError, match="mark"):
        fill_tables(page, {"b": ""})
