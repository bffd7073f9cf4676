"""Recordings read back: whole ones, those of killed writers, and damaged ones."""

import signal
from pathlib import Path

import numpy as np
import pytest
from recorded_heaps import MOVING, header, heap_snapshot, record_heap, recorded, write_elsewhere

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import part_path
from taichi_erosion.recording.readback import HEADER_SIZE, MESSAGE_HEAD, read_grains
from taichi_erosion.recording.stream import flush_recording, log_frame

WRITER = """
import os, signal, sys
from pathlib import Path
from recorded_heaps import MOVING, header, heap_snapshot
from taichi_erosion.recording.stream import flush_recording, log_frame, open_recording
recording = open_recording(Path(sys.argv[1]), header())
for frame in range(30):
    log_frame(recording, heap_snapshot(frame), MOVING)
    if frame == 24:
        flush_recording(recording)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_grains_are_read_back_as_they_were_written_to_single_precision(tmp_path: Path):
    path = tmp_path / "heap.rrd"
    snapshots = record_heap(path)
    frames = read_grains(path)
    assert len(frames) == len(snapshots)
    for frame, snapshot in zip(frames, snapshots, strict=True):
        assert frame.time == pytest.approx(snapshot.time, abs=1e-9)  # rerun counts nanoseconds
        np.testing.assert_array_equal(frame.ident, snapshot.ident)
        np.testing.assert_array_equal(frame.position, snapshot.position.astype(np.float32))
        np.testing.assert_array_equal(frame.radius, snapshot.radius.astype(np.float32))
    mobile = snapshots[-1]
    written = {"velocity": mobile.velocity, "spin": mobile.spin, "force": mobile.force}
    written |= {"contacts": mobile.contacts, "ageing_age": mobile.effect_state["ageing.age"]}
    assert frames[-1].state.keys() == written.keys()
    for name, column in written.items():
        np.testing.assert_array_equal(frames[-1].state[name][-1], column[-1].astype(np.float32))


def test_a_killed_run_leaves_everything_up_to_its_last_flush(tmp_path: Path):
    path = tmp_path / "heap.rrd"
    assert write_elsewhere(WRITER, path).returncode == -signal.SIGKILL
    assert not path.exists()
    frames = read_grains(part_path(path))
    assert 25 <= len(frames) <= 30
    np.testing.assert_array_equal(frames[24].position, heap_snapshot(24).position.astype(np.float32))


def test_a_recording_cut_anywhere_is_read_up_to_the_cut(tmp_path: Path):
    path, sizes = tmp_path / "heap.rrd", []
    with recorded(path, header()) as recording:
        for frame in range(6):
            log_frame(recording, heap_snapshot(frame), MOVING)
            flush_recording(recording)
            sizes.append(part_path(path).stat().st_size)
    whole = path.read_bytes()
    for frame, size in enumerate(sizes):
        path.write_bytes(whole[:size])
        assert len(read_grains(path)) == frame + 1
        path.write_bytes(whole[: sizes[frame - 1] + 1 if frame else 100])
        assert len(read_grains(path)) == frame
        path.write_bytes(whole[: size - 1])
        assert len(read_grains(path)) in (frame, frame + 1), "the last message may be another than the grains"


def test_a_recording_damaged_within_is_refused_by_its_name(tmp_path: Path):
    path = tmp_path / "heap.rrd"
    record_heap(path)
    content, place, messages = bytearray(path.read_bytes()), HEADER_SIZE, []
    while place + MESSAGE_HEAD.size <= len(content):
        length = MESSAGE_HEAD.unpack_from(content, place)[1]
        place += MESSAGE_HEAD.size
        messages += [(length, place)] if place + length <= len(content) else []
        place += length
    length, first = max(messages)
    middle, erased = first + length // 2, 64  # bytes within compressed numbers, not their description
    content[middle : middle + erased] = bytes(erased)
    path.write_bytes(content)
    with pytest.raises(BadInput, match=r"heap\.rrd: the recording is damaged \(.+\)$"):
        read_grains(path)
