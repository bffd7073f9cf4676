"""A sealed trial: truths outside the tree, digests in it, and stored cases that can be drawn again."""

import json
import pickle
from dataclasses import asdict

import pytest

from doe.trials.reduced import beyond
from doe.trials.reduced.families import FAMILIES
from doe.trials.run import SealedSet, answered_again, committed, opened, plain, rows, seal
from doe.trials.table import add_rows, read_rows, table_of, write_rows
from taichi_erosion.core.files import write_atomic


@pytest.fixture
def trial(tmp_path) -> SealedSet:
    made = SealedSet("beyond", "few", tmp_path / "work", tmp_path / "seals")
    seal(made, tmp_path / "secret", 2)
    answer = {"method": "m", "verdict": "none_detected", "named": [], "group": [], "seconds": 0.5}
    write_atomic(made.folder / "case_00000.json", json.dumps(answer).encode())
    return made


def test_an_answered_case_is_opened_with_its_method(trial, tmp_path):
    (row,) = rows(trial, tmp_path / "secret")
    assert (row["set"], row["case"], row["method"]) == ("few", 0, "m")
    assert row["sha256"] in trial.seals.read_text(encoding="utf-8")
    assert asdict(beyond.draw(int(row["seed"], 16))[1]) == row["truth"]
    assert row["difficulty"]["ratio"] >= 0.0
    # another truth than the sealed one is refused
    secret = tmp_path / "secret" / "beyond_few.json"
    secret.write_text(json.dumps(json.loads(secret.read_text(encoding="utf-8"))[::-1]), encoding="utf-8")
    with pytest.raises(ValueError, match="not the one that was sealed"):
        opened(trial, tmp_path / "secret")


def test_a_set_is_sealed_once_and_its_problems_hold_no_truth(trial, tmp_path):
    with pytest.raises(FileExistsError):
        seal(trial, tmp_path / "secret", 2)
    (first, second) = json.loads((tmp_path / "secret" / "beyond_few.json").read_text(encoding="utf-8"))
    assert first != second
    (trial.folder / "case_00000-results").mkdir()  # of an answer that was cut off: no task
    task = trial.tasks[0].read_bytes()
    assert first.encode() not in task
    assert b"Truth" not in task
    assert not hasattr(pickle.loads(task)[0], "truth")


@pytest.mark.parametrize("trial", ["clean", "disturbed", "beyond"])
def test_stored_cases_are_drawn_again_from_their_seed(trial):
    for row in read_rows(table_of(trial))[:3]:
        truth = FAMILIES[trial](int(row["seed"], 16), row["case"]).truth
        assert plain(truth) == plain(row["truth"])
        assert truth["parameters"] == pytest.approx(row["truth"]["parameters"], rel=1e-4)


def test_a_case_is_answered_again_and_one_that_is_drawn_otherwise_is_not():
    row = read_rows(table_of("beyond"))[0]
    found = answered_again("beyond", row, "m")
    assert (found["set"], found["method"]) == (f"{row['set']}, again", "m")
    assert {"verdict", "named", "strengths", "parameters", "vault", "settings"} <= set(found["answer"])
    with pytest.raises(ValueError, match="drawn otherwise"):
        answered_again("beyond", row | {"truth": row["truth"] | {"name": "another"}}, "m")


def test_a_seal_that_is_not_in_the_history_is_seen():
    assert committed(table_of("clean"))
    assert not committed(table_of("no trial"))


def test_rows_of_a_set_are_replaced_and_make_the_same_bytes(tmp_path, monkeypatch):
    monkeypatch.setattr("doe.trials.table.HERE", tmp_path)
    one = {"set": "a", "method": "m", "case": 0, "answer": {"p": 1.0 / 3.0, "vault": [float("nan")]}}
    add_rows("trial", [one])
    before = table_of("trial").read_bytes()
    add_rows("trial", [one])
    assert table_of("trial").read_bytes() == before
    add_rows("trial", [one | {"set": "b"}])
    assert [row["set"] for row in read_rows(table_of("trial"))] == ["a", "b"]
    assert read_rows(table_of("trial"))[0]["answer"] == {"p": 0.333333, "vault": [None]}
    write_rows(table_of("trial"), [])
    assert read_rows(table_of("trial")) == []
