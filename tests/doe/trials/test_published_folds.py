"""Folds of published series: every source once, a vault of nothing else, and their table."""

from collections import Counter

import pytest

from doe.trials.answers import likeliest_of
from doe.trials.published.folds import Fold, comparable, fit_error, folds, write_study
from doe.trials.table import read_rows, table_of
from taichi_erosion.evidence.models.load_study import load_study


def test_there_are_more_than_six_series_of_two_sources_and_more():
    counts = Counter(fold.series for fold in folds())
    assert len(counts) >= 6
    assert min(counts.values()) >= 2


@pytest.mark.parametrize("fold", list(folds()), ids=lambda fold: f"{fold.series}_{fold.number}")
def test_the_vault_of_a_fold_is_one_source(fold: Fold, tmp_path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("doe.trials.published.folds.FOLDER", tmp_path)
    write_study(fold)
    problem = load_study(fold.study).problem
    held_out = problem.hidden()
    assert set(held_out.source) == {fold.source}
    assert fold.source not in problem.visible().source


def test_the_likeliest_is_a_single_candidate():
    found = {"probabilities": {"none": 0.6, "a+b": 0.3, "a": 0.04, "b": 0.06}, "effects": {"a": {}, "b": {}}}
    assert likeliest_of(found) == ["b"]
    assert likeliest_of({"probabilities": {"none": 1.0}, "effects": {"a": {}}}) == []


@pytest.mark.parametrize(
    ("series", "source", "rows", "valued"),
    [("flux_field", "Martin Jericoacoara", 7, 11), ("impact_threshold_simulated", "Chepil 1945", 7, 7)],
)
def test_errors_count_rows_with_a_known_value_and_one_of_the_model(
    series: str, source: str, rows: int, valued: int, tmp_path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("doe.trials.published.folds.FOLDER", tmp_path)
    fold = next(fold for fold in folds() if (fold.series, fold.source) == (series, source))
    write_study(fold)
    problem = load_study(fold.study).problem
    ((name, (own, count)),) = comparable(problem).items()
    assert (own.size, count) == (rows, valued)
    mean = float(problem.hidden().value[own].mean())
    # censored rows of an rms contribute nothing
    rmse = {name: 0.1 * mean * (rows / valued) ** 0.5}
    assert fit_error({"vault_rmse": rmse}, problem) == pytest.approx(10.0)


def test_the_table_has_a_row_for_every_fold_and_its_method():
    stored = read_rows(table_of("published"))
    assert {(row["set"], row["case"]) for row in stored} == {(fold.series, fold.source) for fold in folds()}
    assert not any("dirty" in row["method"] for row in stored)
