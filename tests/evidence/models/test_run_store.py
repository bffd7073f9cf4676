"""A run that was made once is not made again, whoever asks and whatever happened in between."""

import numpy as np
import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.models.run_store import CachedModel, RunStore

ROWS = {"moisture": np.array([0.0, 0.01])}


@pytest.fixture
def counted(tmp_path):
    """Function that puts a counting model in front of the store of this test; calls are shared."""
    calls: list[int] = []

    def model(observable, conditions, parameters, effects, seeds):
        calls.append(len(seeds))
        level = parameters.get("a", 0.0) + sum(effects.values())
        return level + np.asarray(seeds, float)[:, None] + conditions["moisture"][None, :]

    return lambda identity="m 1": (CachedModel(model, identity, RunStore(tmp_path / "runs.sqlite")), calls)


def ask(remembered, parameters=None, effects=None, seeds=(1, 2), observable="repose_angle", rows=ROWS):
    return remembered(observable, rows, parameters or {}, effects or {}, np.array(seeds))


def test_only_the_seeds_that_are_missing_are_run(counted):
    remembered, calls = counted()
    first = ask(remembered, seeds=(1, 2))
    again = ask(remembered, seeds=(2, 5, 1))
    assert calls == [2, 1]
    assert np.array_equal(again[[2, 0]], first)
    assert again[1, 0] == 5.0


def test_runs_outlive_the_process_that_made_them(counted):
    remembered, calls = counted()
    before = ask(remembered)
    remembered.store.commit()
    later, _ = counted()
    assert np.array_equal(ask(later), before)
    assert calls == [2]


def test_an_effect_of_strength_zero_is_no_effect(counted):
    remembered, calls = counted()
    ask(remembered, effects={"lift": 0.0})
    ask(remembered, effects={})
    assert calls == [2]


@pytest.mark.parametrize(
    "change",
    [
        {"parameters": {"a": 1.0}},
        {"effects": {"lift": 1.0}},
        {"observable": "pile_height"},
        {"rows": {"moisture": np.array([0.0, 0.02])}},
        {"rows": {"wetness": np.array([0.0, 0.01]), "moisture": np.array([0.0, 0.01])}},
    ],
    ids=["parameter", "effect", "observable", "condition", "name of a condition"],
)
def test_whatever_goes_into_a_run_makes_it_another_run(counted, change):
    remembered, calls = counted()
    ask(remembered)
    ask(remembered, **change)
    assert calls == [2, 2]


def test_another_version_of_the_model_starts_afresh(counted):
    remembered, calls = counted()
    ask(remembered)
    remembered.store.commit()
    ask(counted("m 2")[0])
    assert calls == [2, 2]


def test_a_value_that_could_not_be_computed_is_remembered_as_such(tmp_path):
    calls: list[int] = []

    def failing(*_):
        calls.append(1)
        return np.full((1, 2), np.nan)

    remembered = CachedModel(failing, "m", RunStore(tmp_path / "runs.sqlite"))
    ask(remembered, seeds=(1,))
    assert np.isnan(ask(remembered, seeds=(1,))).all()
    assert calls == [1]


def test_a_file_that_is_no_store_is_told(tmp_path, counted):
    (tmp_path / "runs.sqlite").write_text("not a store, whatever its name says", encoding="utf-8")
    with pytest.raises(BadInput, match="the store of runs cannot be used"):
        ask(counted()[0])
