"""`predict` of a study on scenes ends with runs at the conditions that are asked, its campaign a stand-in."""

from dataclasses import replace
from math import isnan

import pytest

from taichi_erosion.evidence.answers.predictions import predict_study
from taichi_erosion.evidence.emulator import training_runs
from tests.evidence.asking import no_progress
from tests.evidence.emulator.test_training_runs import QUICK, executing, heights, keys, write
from tests.evidence.small_study import write_study


@pytest.fixture
def ask(tmp_path, monkeypatch):
    """Predictions at rows of angularity and diameter, and the runs that they took for the first time."""
    path, at, batches = write(tmp_path, 0.0), tmp_path / "at.csv", []
    monkeypatch.setattr(training_runs, "run_requests", executing(batches))

    def asked(*rows: str, options=QUICK):
        at.write_text("\n".join(["angularity,diameter [mm]", *rows]) + "\n", encoding="utf-8")
        before = len(keys(batches))
        return predict_study(path, at, no_progress, options).record, len(keys(batches)) - before

    return asked


def ends(row) -> list[float]:
    return [row.low, row.value, row.high]


def test_runs_answer_at_new_conditions_once_and_whatever_else_is_asked(ask):
    """Between the measured diameters and beyond them; the emulator alone is wrong there, and sure of it."""
    alone, _ = ask("0.5,4")
    again, more = ask("0.5,4")
    assert (again, more, alone.new_runs) == (alone, 0, 2)
    both, more = ask("0.4,2", "0.5,4")
    assert (both.new_runs, more) == (4, 2)
    for row in both.rows:
        exact = heights(1e-3 * row.conditions["diameter"], 0.2, 0.0, 0.0)
        assert row.low < exact[row.observable == "centroid_height"] < row.high
        assert row.high < 1.1 * row.low
    for row, company in zip(alone.rows, both.rows[2:], strict=True):
        assert ends(company) == pytest.approx(ends(row), rel=1e-9)


def test_an_emulator_answers_alone_where_it_was_trained_whatever_no_run_reads(ask):
    """Angularity enters no run of the bare model."""
    told, _ = ask("0.55,1.5")
    assert told.new_runs == 0
    assert not any(isnan(row.value) for row in told.rows)


def test_no_value_is_told_where_the_scene_takes_no_run_or_the_budget_is_spent(ask):
    told, _ = ask("0.5,30")
    assert (told.new_runs, [isnan(row.value) for row in told.rows]) == (0, [True, True])
    spent, _ = ask("0.5,1.5", "0.4,2", options=replace(QUICK, runs=26))
    assert (spent.new_runs, [isnan(row.value) for row in spent.rows]) == (0, [False, False, True, True])


def test_the_cost_that_is_told_counts_the_runs_at_new_conditions(ask):
    sentences = []
    ask("0.5,2", "0.1,4", options=replace(QUICK, announce=sentences.append))
    assert "at most 4 that it ends with" in sentences[0]


def test_a_formula_makes_no_runs(tmp_path):
    study = write_study(tmp_path, {})
    table = tmp_path / "at.csv"
    table.write_text("moisture [%],diameter [um]\n30,3000\n", encoding="utf-8")
    assert predict_study(study, table, no_progress).record.new_runs == 0
