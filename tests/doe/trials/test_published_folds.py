"""Folds of published series: every source once, a vault of nothing else."""

from collections import Counter

import pytest

from doe.trials.published.folds import Fold, folds, write_study
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
