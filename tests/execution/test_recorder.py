"""Recorders on a disk that fills up."""

from types import SimpleNamespace
from typing import Any

import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.execution import recorder
from taichi_erosion.execution.stages import ReplicaState


def test_a_disk_that_fills_up_ends_the_recording_whole_and_not_the_run(monkeypatch, tmp_path):
    closed = []
    monkeypatch.setattr(recorder.stream, "is_disk_nearly_full", lambda _: True)
    monkeypatch.setattr(recorder.stream, "log_text", lambda *_: None)
    monkeypatch.setattr(recorder.stream, "close", closed.append)
    monkeypatch.setattr(recorder, "record_frame_and_picture", lambda *_: pytest.fail("still recording"))
    recording = SimpleNamespace(path=tmp_path / "few.rrd")
    open_recorder = SimpleNamespace(replica=0, interval=0.01, recording=recording)
    ensemble = SimpleNamespace(time=0.5, states=[ReplicaState(0)])
    for _ in range(2):
        recorder.record_replica(open_recorder, ensemble)  # type: ignore[arg-type]
    assert closed == [recording]
    assert ensemble.states[0].warnings == ["the disk is nearly full: the recording ends at 0.5 s"]


def test_files_that_cannot_be_finished_cost_no_result(monkeypatch):
    def refuse(*_: Any) -> Any:
        raise BadInput("few.gif: cannot be written (No space left on device)")

    monkeypatch.setattr(recorder, "write_silhouettes_and_film", refuse)
    record = {"seed": 1, "measures": {"height": {"value": 1.0}}, "warnings": ["flank not straight"]}
    unwritten = SimpleNamespace(recording=SimpleNamespace(path="few.rrd"))
    assert recorder.finish_recording(unwritten, None, record, {}) == {}  # type: ignore[arg-type]
    assert record["measures"] == {"height": {"value": 1.0}}
    assert record["warnings"][0] == "few.gif: cannot be written (No space left on device)"
