"""A run that was made once is not made again, whoever asks and whatever happened in between."""

import numpy as np
import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.models.run_store import FunctionModel, RunStore
from tests.evidence.asking import ask as asked
from tests.evidence.small_study import study_text, write_study

ROWS = {"moisture": np.array([0.0, 0.01])}


@pytest.fixture
def counted(tmp_path):
    """Function that puts a counting model in front of the store of this test; calls are shared."""
    calls: list[int] = []

    def model(observable, conditions, parameters, effects, seeds):
        calls.append(len(seeds))
        level = parameters.get("a", 0.0) + sum(effects.values())
        return level + np.asarray(seeds, float)[:, None] + conditions["moisture"][None, :]

    return lambda **cap: (FunctionModel(model, "m 1", RunStore(tmp_path / "runs.sqlite"), **cap), calls)


def ask(remembered, parameters=None, effects=None, seeds=(1, 2), observable="repose_angle", rows=ROWS):
    return remembered(observable, rows, parameters or {}, effects or {}, np.array(seeds))


def test_only_the_seeds_that_are_missing_are_run_in_this_process_or_a_later_one(counted):
    remembered, calls = counted()
    first = ask(remembered, seeds=(1, 2))
    again = ask(remembered, seeds=(2, 5, 1))
    assert np.array_equal(again[[2, 0]], first)
    assert again[1, 0] == 5.0
    remembered.store.commit_runs()
    later, _ = counted()
    assert np.array_equal(ask(later), first)
    assert calls == [2, 1]


def test_whatever_goes_into_a_run_makes_it_another_run(counted):
    remembered, calls = counted()
    ask(remembered)
    ask(remembered, parameters={"a": 1.0})
    ask(remembered, effects={"lift": 1.0})
    ask(remembered, observable="pile_height")
    ask(remembered, rows={"moisture": np.array([0.0, 0.02])})
    ask(remembered, rows={"wetness": np.array([0.0, 0.01]), **ROWS})
    assert calls == [2] * 6


def test_a_cap_on_runs_holds_and_counts_every_seed_of_every_row_once(counted):
    capped, calls = counted(cap=9)
    for seeds in ((1, 2), (1, 2), (1, 2, 3, 4)):  # 4 runs, none, 4 more
        ask(capped, seeds=seeds)
    with pytest.raises(BadInput, match="the budget of 9 runs is used up: 10 and more are needed"):
        ask(capped, seeds=(5,))
    assert calls == [2, 2]


def test_no_answer_of_a_function_passes_its_budget(tmp_path):
    text = study_text() + "[budget]\nruns = 5000\n"
    found = asked("discover", write_study(tmp_path, {"liquid_bridge": 1.0}, study=text))
    assert found.record.stopped == found.document["stopped"] == "budget"
    assert found.record.named == ("liquid_bridge",), "what is known so far"
    assert found.answer().lines[-2].startswith("Stopped at the budget")
    assert 4000 < found.record.runs <= 5000
