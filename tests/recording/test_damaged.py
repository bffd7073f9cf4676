"""Recordings damaged within: what the reader can see, it says in one line."""

from pathlib import Path

import pytest
from recorded_heaps import record_heap

from taichi_erosion.cli.main import ExitCode, main
from taichi_erosion.core.errors import BadInput
from taichi_erosion.recording.readback import HEADER_SIZE, MESSAGE_HEAD, read_grains

ERASED = 64  # bytes in the middle of a message: within compressed numbers, not within their description


def largest_message(content: bytes) -> tuple[int, int]:
    """First byte and length of what the longest message holds."""
    found, place = (0, 0), HEADER_SIZE
    while place + MESSAGE_HEAD.size <= len(content):
        _, length = MESSAGE_HEAD.unpack_from(content, place)
        place += MESSAGE_HEAD.size
        if place + length <= len(content):
            found = max(found, (place, length), key=lambda message: message[1])
        place += length
    return found


@pytest.fixture
def damaged(tmp_path: Path) -> Path:
    """A whole recording in which a piece of one message reads zero."""
    path = tmp_path / "heap.rrd"
    record_heap(path)
    content = bytearray(path.read_bytes())
    first, length = largest_message(content)
    middle = first + length // 2
    content[middle : middle + ERASED] = bytes(ERASED)
    path.write_bytes(content)
    return path


def test_a_recording_damaged_within_is_refused_by_its_name(damaged: Path):
    with pytest.raises(BadInput, match=r"heap\.rrd: the recording is damaged \(.+\)$"):
        read_grains(damaged)


def test_the_export_of_a_damaged_recording_is_one_line_and_no_file(
    damaged: Path, capsys: pytest.CaptureFixture[str]
):
    folder = damaged.parent / "out"
    assert main(["export", str(damaged), "--vtk", str(folder)]) == ExitCode.BAD_INPUT
    said = capsys.readouterr().err
    assert "is damaged" in said
    assert said.count("\n") == 1
    assert not folder.exists()
