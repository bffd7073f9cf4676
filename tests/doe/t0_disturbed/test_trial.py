"""A sealed trial: the truth cannot be changed afterwards, and the problem does not hold it."""

import json
import pickle

import pytest

from doe.common.sealed_set import SealedSet
from doe.sealed.oracle import Difficulty
from doe.sealed.solve import Outcome
from doe.t0_disturbed.laboratory import DisturbedTruth
from doe.t0_disturbed.page import metric_table
from doe.t0_disturbed.trial import DIGITS, Judged, opened, seal
from taichi_erosion.core.files import write_atomic

NOTHING = (float("nan"),) * 3


def answered(number: int, verdict: str = "none_detected", named: tuple[str, ...] = ()) -> Outcome:
    return Outcome(number, verdict, named, (), {"none": 1.0}, 0.5, {}, {}, NOTHING, 1, 0.1)


@pytest.fixture
def trial(tmp_path) -> SealedSet:
    made = SealedSet("few", tmp_path / "secret", tmp_path / "work", tmp_path / "tables", DIGITS)
    seal(made, 2, 1.0)
    text = json.dumps(vars(answered(0))).encode()
    made.answer(0, "m").parent.mkdir(parents=True)
    write_atomic(made.answer(0, "m"), text)
    return made


def test_an_answered_case_is_opened_with_its_method(trial):
    (row,) = opened(trial, "m")
    assert row["method"] == "m"
    assert json.loads(row["truth"])["kind"] == "null"


def test_a_truth_that_was_changed_after_its_seal_is_refused(trial):
    trial.truth(0).write_text(trial.truth(0).read_text().replace('"null"', '"single"'), encoding="utf-8")
    with pytest.raises(ValueError, match="not the one that was sealed"):
        opened(trial, "m")


def test_a_set_is_sealed_once(trial):
    with pytest.raises(FileExistsError):
        seal(trial, 2, 1.0)


def test_a_problem_names_neither_truth_nor_salt(trial):
    hidden = json.loads(trial.truth(0).read_text(encoding="utf-8"))
    problem = trial.problem(0).read_bytes()
    assert hidden["salt"].encode() not in problem
    assert not hasattr(pickle.loads(problem), "truth")


def test_a_target_counts_as_met_by_its_bound():
    truth = DisturbedTruth("null", {}, {}, False, "", "none", 0.0)
    hard = Difficulty(0.0, 9.0)
    silent = [Judged(truth, hard, answered(k)) for k in range(50)]
    (line,) = [row for row in metric_table(silent).splitlines() if "any name" in row]
    assert "| 0.000 |" in line
    assert "**no**" in line, "50 silent nulls leave room for 7 %"
    (line,) = [row for row in metric_table(silent * 4).splitlines() if "any name" in row]
    assert line.endswith("| yes |")
