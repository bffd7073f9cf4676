"""Checkpoints at intervals, and on a disk that refuses them."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.run.checkpointer import Checkpointer
from taichi_erosion.run.stages import ReplicaState


def test_a_checkpoint_is_saved_once_per_interval(monkeypatch):
    saved = []
    monkeypatch.setattr(Checkpointer, "save", lambda _, ensemble: saved.append(ensemble.time))
    checkpointer = Checkpointer(Path("run.npz"), 0.02, {})
    for step in range(1, 11):
        checkpointer(SimpleNamespace(time=step * 0.005))  # type: ignore[arg-type]
    assert saved == [4 * 0.005, 8 * 0.005]


def test_a_checkpoint_that_cannot_be_written_is_told_once_and_the_run_goes_on(monkeypatch):
    def refuse(*_: Any) -> None:
        raise BadInput("run.npz: the checkpoint cannot be written (No space left on device)")

    monkeypatch.setattr(Checkpointer, "save", refuse)
    checkpointer, state = Checkpointer(Path("run.npz"), 0.1, {}), ReplicaState(0)
    for time in (0.5, 0.6):
        checkpointer(SimpleNamespace(time=time, states=[state]))  # type: ignore[arg-type]
    assert state.warnings == ["run.npz: the checkpoint cannot be written (No space left on device)"]
