"""A disk that is full, nearly full, or shared with another writer: what is kept, and what is said."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_heaps import MOVING, header, heap_snapshot, recorded, write_elsewhere

from taichi_erosion.core.errors import BadInput
from taichi_erosion.recording import stream
from taichi_erosion.recording.readback import read_grains
from taichi_erosion.recording.stream import log_frame, open_recording
from taichi_erosion.scene.checkpoint_file import load_checkpoint, save_checkpoint

WRITER = """
import resource, sys
from pathlib import Path
from recorded_heaps import MOVING, header, heap_snapshot
from taichi_erosion.recording import stream

stream.FREE_SPACE_LEAST = 0  # as if another program had filled the disk since
stream.FLUSH_LIMIT = 1.0  # s
if limit := int(sys.argv[2]):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
try:
    recording = stream.open_recording(Path(sys.argv[1]), header())
    for frame in range(60):
        stream.log_frame(recording, heap_snapshot(frame), MOVING)
        stream.flush_recording(recording)
    stream.close(recording)
except stream.BadInput as error:
    print(error)  # not to stderr, where the logger of rerun writes meanwhile
"""


def write_until_refused(path: Path, limit: int) -> None:
    """Record under a limit of the file's size [byte]; the refusal is told and the beginning kept."""
    ended = write_elsewhere(WRITER, path, limit)
    assert ended.stdout == f"{path}: cannot be written to its end; {path}.part holds the beginning\n"
    assert not path.exists()
    assert 1 <= len(read_grains(path.with_name("heap.rrd.part"))) < 60


def test_a_recording_that_may_not_grow_is_told_and_keeps_its_beginning(tmp_path: Path):
    write_until_refused(tmp_path / "heap.rrd", limit=120_000)


def test_a_recording_on_a_full_disk_is_told_keeps_its_beginning_and_lets_the_program_end(mounted):
    write_until_refused(mounted("size=120k") / "heap.rrd", limit=0)


def test_a_nearly_full_disk_is_told_before_anything_is_recorded(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=stream.FREE_SPACE_LEAST - 1))
    with pytest.raises(BadInput, match="the disk is nearly full; make room, or give --no-record"):
        open_recording(tmp_path / "heap.rrd", header())
    assert list(tmp_path.iterdir()) == []


def test_two_runs_do_not_write_one_recording(tmp_path: Path):
    path = tmp_path / "heap.rrd"
    with recorded(path, header()) as first:
        with pytest.raises(BadInput, match=r"heap\.rrd\.part: another process is writing it"):
            open_recording(path, header())
        log_frame(first, heap_snapshot(), MOVING)
    assert len(read_grains(path)) == 1
    with recorded(path, header()):
        pass  # the right to write ends with the recording


def test_a_full_disk_leaves_the_checkpoint_before_and_nothing_beside_it(mounted):
    path = mounted("size=120k") / "run.npz"
    save_checkpoint(path, {"x": np.arange(10)}, {"scene_hash": "a"})
    with pytest.raises(BadInput, match=r"run\.npz: the checkpoint cannot be written \(No space left"):
        save_checkpoint(path, {"x": np.random.default_rng(1).random(100_000)}, {"scene_hash": "b"})
    assert load_checkpoint(path)[1] == {"scene_hash": "a"}
    assert [entry.name for entry in path.parent.iterdir()] == ["run.npz"]
