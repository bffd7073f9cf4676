"""An emulator that is wrong on purpose loses the name that it found; a right one: test_training_runs.py."""

from dataclasses import dataclass

import pytest

from taichi_erosion.evidence.emulator import gaussian_process, training_runs
from tests.evidence.emulator.test_training_runs import STUDY, ask, executing, keys, write

NAME = "rolling_resistance"
OFF = 0.2  # sd of the training values, by which the emulator overstates the effect at strength 1
MOST = 26  # runs of a budget that the training takes
SHORT = STUDY.replace(', "dry_adhesion", "restitution_speed"', ', "dry_adhesion"')


@dataclass(frozen=True)
class Wrong:
    """Two answers in turn of an emulator that is wrong, and the runs that each asked for."""

    found: dict
    again: dict
    runs: list[list[list[str]]]


def overstated(exact):
    """A mean that overstates what the first effect does, and does not know it."""

    def mean(self, at):
        return exact(self, at) + OFF * self.width * at.psi[:, 0]

    return mean


@pytest.fixture(scope="module")
def wrong(tmp_path_factory) -> Wrong:
    path = write(tmp_path_factory.mktemp("wrong"), 1.5, text=SHORT)
    process, runs, told = gaussian_process.GaussianProcess, [], []
    for _ in range(2):
        runs.append([])
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(training_runs, "execute", executing(runs[-1]))
            patch.setattr(process, "mean", overstated(process.mean))
            told.append(ask("discover", str(path), "--budget", "quick"))
    return Wrong(*told, runs)


def test_a_name_that_new_simulations_contradict_is_withdrawn(wrong):
    found, check = wrong.found, wrong.found["fresh_runs"]
    assert (found["verdict"], found["named"], found["group"]) == ("unstable", [], [NAME])
    assert check["outcome"] == "contradicted"
    assert found["effects"][NAME]["status"] == "not_testable"
    assert found["sentences"][0].startswith(f"An emulator of the training runs named {NAME}")
    named = check["settings"][0]
    assert named["chi2_per_row_simulated"] > 3.0 > 1.0 > named["chi2_per_row_emulated"]
    assert named["gap"]["p"] < 0.01
    assert named["gap"]["emulated"] > named["gap"]["simulated"], "the effect was overstated"
    assert f"off with {NAME} by more than it states" in check["sentence"]


def test_the_next_answer_makes_more_runs_first_and_is_tested_anew(wrong):
    more = wrong.found["fresh_runs"]["more_runs"]
    assert more > 0
    assert str(more) in wrong.found["sentences"][0]
    (again, fresh), before = wrong.runs[1], keys(wrong.runs[0])
    assert len(set(again) - before) == more
    assert not set(fresh) & before
    assert wrong.again["verdict"] == "unstable", "the emulator is as wrong as before"


def test_without_room_the_answer_is_told_untested(tmp_path, monkeypatch):
    batches: list[list[str]] = []
    monkeypatch.setattr(training_runs, "execute", executing(batches))
    path = write(tmp_path, 1.5, text=f"{SHORT}[budget]\nruns = {MOST}\n")
    found = ask("discover", str(path))
    check = found["fresh_runs"]
    assert check["outcome"] == "not_made"
    assert check["needed"] > MOST - len(keys(batches))
    assert found["named"] == [NAME]
    assert found["stability"] is None
    assert any("not tested by new simulations" in sentence for sentence in found["sentences"])
