"""Cases of studies: their tables are complete and come back from a file, a case is one command."""

import csv
import json
import subprocess
from dataclasses import fields
from math import isfinite, nan
from pathlib import Path

import pytest

from doe.common.cases import GUARDED, STOPPED, Case, Row, command, read_rows, settings, simulate, write_rows
from doe.common.pages import fill_tables
from doe.lab_c import page as lab_c
from taichi_erosion.core.errors import BadInput
from taichi_erosion.tables.number_words import markdown_table

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
    assert repr(read_rows(tmp_path / "t.csv")) == repr(rows)  # NaN differs from itself, its text does not


def test_a_case_is_the_command_that_repeats_it():
    case = Case("g", "l", settings("grains.count=10"), 2)
    typed = "run s.toml --set grains.count=10 --replicas 2 --threads 1 --no-record --json"
    assert " ".join(command("s.toml", case)) == typed


# what `run --json` prints of one observable where one of two seeds was stopped, as far as a table holds it
SOME_STOPPED = {
    "limits": {"time_step": 1e-5, "time_step_over_rayleigh": 0.2},
    "replicas": [{"stopped": None}, {"stopped": "overlap"}],
    "measures": {"repose_angle": {"value": 30.0, "sd": 2.0, "n": 1, "unit": "deg", "notes": []}},
    "resolved": {"grains": {"count": 10}},
} | {"hash": "0" * 12, "seed": 1, "wall_s": 1.0, "versions": {}}


def test_seeds_that_a_guard_stopped_are_told_in_their_row_and_a_refusal_ends_the_study(monkeypatch):
    said = {"some": (GUARDED, json.dumps(SOME_STOPPED)), "all": (GUARDED, ""), "refused": (2, "")}
    ends = iter(subprocess.CompletedProcess((), *end, "stopped: overlap") for end in said.values())
    monkeypatch.setattr(subprocess, "run", lambda *words, **options: next(ends))
    case = Case("g", "l", ())
    (some,), (none,) = simulate("s.toml", case), simulate("s.toml", case)
    assert (some.value, some.n, some.note) == (30.0, 1, "1 seeds stopped: overlap")
    assert (none.observable, none.n, none.note) == (STOPPED, 0, "stopped: overlap")
    with pytest.raises(BadInput, match="stopped: overlap"):
        simulate("s.toml", case)


def test_a_mark_without_a_table_is_noticed():
    page = "before\n<!-- table: a -->\nold\n<!-- end -->\nafter\n"
    assert fill_tables(page, {"a": markdown_table(("x",), [("1",)])}).count("| 1 |") == 1
    with pytest.raises(ValueError, match="mark"):
        fill_tables(page, {"b": ""})
