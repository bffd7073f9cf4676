"""An emulator that is wrong on purpose loses the name that it found; a right one: test_training_runs.py."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from taichi_erosion.evidence.emulator import gaussian_process, training_runs
from taichi_erosion.evidence.race.record import Record
from tests.evidence.asking import ask
from tests.evidence.emulator.test_training_runs import NAME, QUICK, STUDY, executing, keys, write

OFF = 0.2  # sd of the training values, by which the emulator overstates the effect at strength 1
MOST = 26  # runs of a budget that the training takes


@dataclass(frozen=True)
class Wrong:
    """Answer of an emulator that is wrong, and the runs that it asked for."""

    study: Path
    found: Record
    runs: list[list[str]]


def overstated(exact):
    """A mean that overstates what the first effect does, and does not know it."""

    def mean(self, at):
        return exact(self, at) + OFF * self.width * at.psi[:, 0]

    return mean


def told_wrong(path: Path) -> Wrong:
    process, runs = gaussian_process.GaussianProcess, []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training_runs, "execute", executing(runs))
        patch.setattr(process, "mean", overstated(process.mean))
        return Wrong(path, ask("discover", path, options=QUICK).record, runs)


@pytest.fixture(scope="module")
def wrong(tmp_path_factory) -> Wrong:
    return told_wrong(write(tmp_path_factory.mktemp("wrong"), 1.5))


def test_a_name_that_new_simulations_contradict_is_withdrawn(wrong):
    decided, fresh = wrong.found.decided, wrong.found.fresh
    assert (decided.verdict, decided.named, decided.group) == ("unstable", (), (NAME,))
    assert fresh.outcome == "contradicted"
    assert fresh.gap.p < 0.01
    assert fresh.gap.emulated > fresh.gap.simulated, "the effect was overstated"


@pytest.mark.slow
def test_the_next_answer_makes_more_runs_first_and_is_tested_anew(wrong):
    more = wrong.found.fresh.more_runs
    assert more > 0
    again = told_wrong(wrong.study)
    (training, fresh), before = again.runs, keys(wrong.runs)
    assert len(set(training) - before) == more
    assert not set(fresh) & before
    assert again.found.decided.verdict == "unstable", "the emulator is as wrong as before"


@pytest.mark.slow
def test_without_room_the_answer_is_told_untested(tmp_path, monkeypatch):
    batches: list[list[str]] = []
    monkeypatch.setattr(training_runs, "execute", executing(batches))
    found = ask("discover", write(tmp_path, 1.5, text=f"{STUDY}[budget]\nruns = {MOST}\n")).record
    assert found.fresh is not None
    assert found.fresh.outcome == "not_made"
    assert found.fresh.needed > MOST - len(keys(batches))
    assert found.decided.named == (NAME,)
