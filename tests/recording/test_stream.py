"""Recordings as they are written: static and mobile grains, walls, texts, properties."""

from dataclasses import replace
from math import sqrt
from pathlib import Path

import numpy as np
import pytest
from recorded_heaps import (
    FLOOR,
    MOVING,
    header,
    heap_snapshot,
    moved,
    read_frames,
    read_properties,
    read_series,
    recorded,
    totals,
)

from taichi_erosion.core.errors import BadInput
from taichi_erosion.recording.pictures import night
from taichi_erosion.recording.readback import read_chunks, read_grains, read_rows
from taichi_erosion.recording.stream import (
    CREEP,
    REWRITE_INTERVAL,
    close,
    log_frame,
    log_image,
    log_text,
    log_totals,
    log_wall_pose,
    log_wall_removed,
    open_recording,
    set_properties,
)
from taichi_erosion.recording.wall_mesh import WallMesh

FRAMES = 20
TUBE = WallMesh("lifting tube", FLOOR.vertices, FLOOR.triangles, moving=True)
ENTITY = "world/walls/lifting\\ tube"


@pytest.fixture(scope="module")
def heap(tmp_path_factory) -> Path:
    """A recording with everything in it: a tube that is turned after frame 1 and taken away after frame 2."""
    path = tmp_path_factory.mktemp("stream") / "heap.rrd"
    with recorded(path, replace(header(), walls=(FLOOR, TUBE))) as recording:
        for frame in range(FRAMES):
            log_frame(recording, heap_snapshot(frame), MOVING)
            log_totals(recording, totals(frame))
            if frame == 1:
                log_wall_pose(recording, TUBE.name, (0.0, 0.0, 0.01), (sqrt(0.5), 0.0, 0.0, sqrt(0.5)))
            if frame == 2:
                log_wall_removed(recording, TUBE.name)
                log_text(recording, "WARN", "the heap is truncated by the plate")
                log_image(recording, "silhouette", night((30, 20)))
        set_properties(recording, "doe", {"contact.soil-soil.friction_rolling": 0.3})
        set_properties(recording, "result", {"repose_angle": 33.5, "flag": None, "n": 3, "straight": True})
    return path


def test_a_resting_bed_is_written_once_while_mobile_grains_are_written_every_frame(heap: Path):
    # frame 0: the last grain has no speed yet and counts as resting; it leaves the bed at the next frame
    assert [len(positions) for _, positions in read_frames(heap, "world/bed")] == [205, 204]
    assert [len(positions) for _, positions in read_frames(heap, "world/mobile")] == [0] + [1] * (FRAMES - 1)


def test_totals_are_read_back_as_curves_and_energies_also_in_decades(heap: Path):
    times, contacts = read_series(heap, "ledger/contacts")
    np.testing.assert_allclose(times, [totals(frame).time for frame in range(FRAMES)], atol=1e-9)
    np.testing.assert_array_equal(contacts, [totals(frame).contacts for frame in range(FRAMES)])
    # one rounding of 10 ** x and one of its logarithm
    decades = read_series(heap, "decades/kinetic_translation")[1]
    np.testing.assert_allclose(decades, -0.1 * np.arange(FRAMES), atol=1e-15)
    # an energy of zero has no decade
    assert len(read_series(heap, "ledger/kinetic_rotation")[0]) == FRAMES
    assert len(read_series(heap, "decades/kinetic_rotation")[0]) == 0


def test_properties_are_read_back_and_those_without_a_value_are_left_out(heap: Path):
    assert read_properties(heap) == {
        "doe": {"contact.soil-soil.friction_rolling": 0.3},
        "result": {"repose_angle": 33.5, "n": 3, "straight": True},
    }


def test_the_recording_carries_its_blueprint_its_names_and_simulated_time_alone(heap: Path):
    from rerun.chunk import RrdReader

    reader = RrdReader(heap)
    (recording,) = reader.recordings()
    assert (recording.application_id, recording.recording_id) == ("taichi_erosion", "test-run")
    assert len(reader.blueprints()) == 1
    timelines = {name for chunk in read_chunks(heap) for name in chunk.timeline_names}
    assert timelines == {"sim_time", "step"}


def test_a_wall_is_turned_and_taken_away_at_its_times_and_texts_stand_at_the_frame_before(heap: Path):
    ((_, pose),) = read_rows(heap, ENTITY, "Transform3D:quaternion")
    # rerun stores x, y, z, w in single precision
    quaternion = pose["Transform3D:quaternion"][0]
    np.testing.assert_allclose(quaternion, [0.0, 0.0, sqrt(0.5), sqrt(0.5)], rtol=1e-7)
    written = {"log": "TextLog:text", "silhouette": "EncodedImage:blob", ENTITY: "Clear:is_recursive"}
    for entity, component in written.items():
        assert [time for time, _ in read_rows(heap, entity, component)] == [20_000_000]
    static = {chunk.entity_path for chunk in read_chunks(heap) if chunk.is_static}
    assert "/world/walls/plate" in static
    assert "/" + ENTITY not in static


def test_every_grain_is_either_in_the_bed_or_mobile(tmp_path: Path):
    path = tmp_path / "heap.rrd"
    with recorded(path, header()) as recording:
        for frame in range(2 * REWRITE_INTERVAL):
            restless = moved(heap_snapshot(frame), frame, speed=3.0 * MOVING)
            log_frame(recording, restless, MOVING)
    for frame in read_grains(path):
        np.testing.assert_array_equal(frame.ident, heap_snapshot().ident)


def test_a_creeping_grain_is_never_shown_further_away_than_the_creep_allowed(tmp_path: Path):
    path, crept = tmp_path / "heap.rrd", [moved(heap_snapshot(3), 7, 3e-6 * frame) for frame in range(40)]
    with recorded(path, header()) as recording:
        for frame, snapshot in enumerate(crept):
            log_frame(recording, replace(snapshot, time=0.01 * frame), MOVING)
    largest = CREEP * heap_snapshot().radius[7]
    shown = np.array([frame.position[7, 0] for frame in read_grains(path)])
    # 1e-9 m: single precision at a millimetre
    assert np.abs(shown - [snapshot.position[7, 0] for snapshot in crept]).max() <= largest + 1e-9


def test_the_file_takes_its_name_only_when_it_is_whole(tmp_path: Path):
    path = tmp_path / "new" / "heap.rrd"
    recording = open_recording(path, header())
    log_frame(recording, heap_snapshot(), MOVING)
    assert not path.exists()
    assert close(recording) == path
    assert [entry.name for entry in path.parent.iterdir()] == ["heap.rrd"]
    assert close(recording) == path
    with pytest.raises(BadInput, match=r"next\.rrd: its folder cannot be made"):
        open_recording(path / "next.rrd", header())
