"""Faults of a set-up in its training runs, the campaign replaced by a stand-in."""

from pathlib import Path

import numpy as np
import pytest

from taichi_erosion.campaign.request import RunResult
from taichi_erosion.evidence.answers.files import Reply
from taichi_erosion.evidence.emulator import training_runs
from taichi_erosion.evidence.models.load_study import StudyOptions
from tests.evidence.asking import ask as asked

SCENE = Path(__file__).parents[3] / "scenes" / "column_collapse.toml"
STUDY = """
[study]
measurements = "heap.csv"
[observables.angle_of_repose]
scene = "column_collapse.toml"
{more}
[conditions]
angularity = "conditions.angularity"
[parameters."contact.grain-grain.friction_rolling"]
start = 0.15
low = 0.02
high = 0.6
[candidates]
effects = ["rolling_resistance", "dry_adhesion"]
[vault]
fraction = 0.0
"""
MEASURED = (31.0, 33.0, 35.0, 38.0, 41.0, 43.0)
LACKING = dict(flag="small_heap", sentence="small", found=1.2, needed=3.0, blocks=True, grains=900)


@pytest.fixture
def ask(tmp_path, monkeypatch):
    """The reply of `discover` where every heap is too small, and every fourth run stops or none."""

    def answer(stops: bool, more: str = "") -> Reply:
        def execute(wanted, store, **options):
            found = []
            for place, request in enumerate(wanted):
                angle = {"value": 3.6 + 0.01 * (place % 7), "unit": "deg", "shortfalls": [LACKING]}
                failure = "grains overlap" if stops and place % 4 == 0 else None
                record = {} if failure else {"measures": {"angle_of_repose": angle}}
                found.append(RunResult(request.key, record, failure))
            return found

        monkeypatch.setattr(training_runs, "execute", execute)
        lines = ["observable,value,sd,n,unit,group,angularity,source"]
        for angularity, angle in zip(np.linspace(0.0, 1.0, len(MEASURED)), MEASURED, strict=True):
            lines.append(f"angle_of_repose,{angle},0.5,5,deg,a{angularity:g},{angularity:g},made")
        (tmp_path / "heap.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
        (tmp_path / SCENE.name).write_text(SCENE.read_text("utf-8"), encoding="utf-8")
        (tmp_path / "heap.toml").write_text(STUDY.format(more=more), encoding="utf-8")
        return asked("discover", tmp_path / "heap.toml", options=StudyOptions(budget="quick"))

    return answer


def test_a_heap_that_is_too_small_is_told_before_any_effect(ask):
    found = ask(stops=False)
    assert found.about["set_up"][0] == f"error: angle_of_repose: {LACKING['sentence']}"
    assert (found.record.decided.verdict, found.record.decided.named) == ("not_testable", ())
    assert found.answer().lines[0] == "No effect is named before the errors above are mended."


def test_runs_that_stop_are_told(ask):
    found = ask(stops=True, more="same_size = true")
    told = next(fault for fault in found.about["faults"] if fault["kind"] == "failed_runs")
    assert "runs stopped and are left out; the first: grains overlap" in told["sentence"]
    assert not told["blocks"]
