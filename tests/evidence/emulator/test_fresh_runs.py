"""Answers of scenes tested by fresh runs, where the emulator is wrong on purpose; right ones: test_training_runs."""

import json
from dataclasses import dataclass
from pathlib import Path

import pytest

from taichi_erosion.evidence.emulator import gaussian_process, training_runs
from tests.evidence.emulator.test_training_runs import ask, executing, keys, write

NAME = "rolling_resistance"
OFF = 0.1  # of the spread of the training values, by which the emulator overstates the effect at strength 1


@dataclass(frozen=True)
class Wrong:
    """Answers of an emulator that is wrong, and the runs that each asked for."""

    found: dict
    again: dict
    runs: list[list[list[str]]]


@pytest.fixture(scope="module")
def wrong(tmp_path_factory) -> Wrong:
    path = write(tmp_path_factory.mktemp("wrong"), 1.5)
    exact, runs, told = gaussian_process.GaussianProcess.mean, [], []

    def mean(self, at):
        return exact(self, at) + OFF * self.width * at.psi[:, 0]

    for _ in range(2):
        runs.append([])
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(training_runs, "execute", executing(runs[-1]))
            patch.setattr(gaussian_process.GaussianProcess, "mean", mean)
            told.append(ask("discover", str(path), "--budget", "quick"))
    return Wrong(*told, runs)


def test_dump(wrong):
    for found in (wrong.found, wrong.again):
        print(json.dumps({k: found[k] for k in ("verdict", "named", "group", "sentences", "probabilities", "fresh_runs")}, indent=1))
        print({k:(v["status"], v["sentence"]) for k,v in found["effects"].items()})
    print([[len(b) for b in r] for r in wrong.runs])
    assert 0
