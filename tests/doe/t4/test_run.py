"""Folds of published series: every source once, a vault of nothing else, and their table."""

from collections import Counter

import pytest

from doe.t4 import run
from doe.t4.run import SERIES, Fold, folds, likeliest, relative, write_study
from taichi_erosion.evidence.models.load_study import load_study


def test_there_are_more_than_six_series_of_two_sources_and_more():
    counts = Counter(fold.series for fold in folds())
    assert len(counts) >= 6
    assert min(counts.values()) >= 2


@pytest.mark.parametrize("fold", list(folds()), ids=lambda fold: f"{fold.series}_{fold.number}")
def test_the_vault_of_a_fold_is_one_source_and_the_forms_have_values_there(
    fold: Fold, tmp_path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(run, "FOLDER", tmp_path)
    write_study(fold)
    problem = load_study(fold.study).problem
    held_out = problem.hidden()
    assert set(held_out.source) == {fold.source}
    assert fold.source not in problem.visible().source
    for form in SERIES[fold.series].forms:
        value = form.at(problem.visible(), held_out)
        assert value.shape == held_out.value.shape
        assert (value >= 0.0).all()


def test_the_likeliest_is_a_single_candidate():
    found = {"probabilities": {"none": 0.6, "a+b": 0.3, "a": 0.04, "b": 0.06}, "effects": {"a": {}, "b": {}}}
    assert likeliest(found) == ["b"]
    assert likeliest({"probabilities": {"none": 1.0}, "effects": {"a": {}}}) == []


def test_an_error_is_relative_to_the_mean_of_its_observable(tmp_path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(run, "FOLDER", tmp_path)
    fold = next(
        fold for fold in folds() if fold.source == "Martin Oceano" and fold.series == "field_thresholds"
    )
    write_study(fold)
    held_out = load_study(fold.study).problem.hidden()
    means = {name: held_out.value[k] for k, name in enumerate(held_out.observable)}
    assert relative({name: 0.1 * value for name, value in means.items()}, held_out) == "10"
