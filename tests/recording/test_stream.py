"""Recordings as they are written: static and mobile grains, walls, texts, properties."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import recorded_heaps as heaps

from taichi_erosion.core.errors import BadInput
from taichi_erosion.recording import stream
from taichi_erosion.recording.pictures import night_background
from taichi_erosion.recording.readback import component_rows, read_chunks, read_grains
from taichi_erosion.recording.wall_mesh import WallMesh

FRAMES = 20
TUBE = WallMesh("lifting tube", heaps.FLOOR.vertices, heaps.FLOOR.triangles, moving=True)
ENTITY = "world/walls/lifting\\ tube"


@pytest.fixture(scope="module")
def heap(tmp_path_factory) -> Path:
    """A recording with everything in it: a tube that is turned after frame 1 and taken away after frame 2."""
    path = tmp_path_factory.mktemp("stream") / "heap.rrd"
    with heaps.recorded(path, replace(heaps.header(), walls=(heaps.FLOOR, TUBE))) as recording:
        for frame in range(FRAMES):
            stream.log_frame(recording, heaps.heap_snapshot(frame), heaps.MOVING)
            stream.log_totals(recording, heaps.totals(frame))
            if frame == 1:
                stream.log_wall_pose(recording, TUBE.name, heaps.QUARTER_TURN, np.array([0.0, 0.0, 0.01]))
            if frame == 2:
                stream.log_wall_removed(recording, TUBE.name)
                stream.log_text(recording, "WARN", "the heap is truncated by the plate")
                stream.log_image(recording, "silhouette", night_background((30, 20)))
        stream.set_run_properties(recording, "doe", {"contact.soil-soil.friction_rolling": 0.3})
        result = {"repose_angle": 33.5, "flag": None, "n": 3, "straight": True}
        stream.set_run_properties(recording, "result", result)
    return path


def test_a_resting_bed_is_written_once_while_mobile_grains_are_written_every_frame(heap: Path):
    # frame 0: the last grain has no speed yet and counts as resting; it leaves the bed at the next frame
    for entity, counts in (("bed", [205, 204]), ("mobile", [0] + [1] * (FRAMES - 1))):
        assert [len(positions) for _, positions in heaps.read_frames(heap, f"world/{entity}")] == counts


def test_resting_grains_that_are_taken_out_leave_the_bed():
    now, rows = heaps.heap_snapshot(1), np.r_[0:50, 60:200]
    bed, _ = stream.update_static_grains(stream.StaticGrains(), now, heaps.MOVING)
    fewer = {name: getattr(now, name)[rows] for name in ("ident", "position", "velocity", "radius")}
    after, _ = stream.update_static_grains(bed, replace(now, **fewer), heaps.MOVING)
    assert np.array_equal(after.ident, now.ident[rows])


def test_totals_are_read_back_as_curves_and_energies_also_in_decades(heap: Path):
    times, contacts = heaps.read_series(heap, "ledger/contacts")
    np.testing.assert_allclose(times, [heaps.totals(frame).time for frame in range(FRAMES)], atol=1e-9)
    np.testing.assert_array_equal(contacts, [heaps.totals(frame).contacts for frame in range(FRAMES)])
    # one rounding of 10 ** x and one of its logarithm
    decades = heaps.read_series(heap, "decades/kinetic_translation")[1]
    np.testing.assert_allclose(decades, -0.1 * np.arange(FRAMES), atol=1e-15)
    # an energy of zero has no decade
    assert len(heaps.read_series(heap, "ledger/kinetic_rotation")[0]) == FRAMES
    assert len(heaps.read_series(heap, "decades/kinetic_rotation")[0]) == 0


def test_the_recording_carries_its_blueprint_names_properties_and_simulated_time_alone(heap: Path):
    from rerun.chunk import RrdReader

    # a property without a value is left out
    found = {"repose_angle": 33.5, "n": 3, "straight": True}
    factors = {"contact.soil-soil.friction_rolling": 0.3}
    assert heaps.read_properties(heap) == {"doe": factors, "result": found}
    reader = RrdReader(heap)
    (recording,) = reader.recordings()
    assert (recording.application_id, recording.recording_id) == ("taichi_erosion", "heap")
    assert len(reader.blueprints()) == 1
    assert {name for chunk in read_chunks(heap) for name in chunk.timeline_names} == {"sim_time", "step"}


def test_a_wall_is_turned_and_taken_away_at_its_times_and_texts_stand_at_the_frame_before(heap: Path):
    ((_, pose),) = component_rows(heap, ENTITY, "Transform3D:mat3x3")
    # rerun stores column by column
    np.testing.assert_array_equal(pose["Transform3D:mat3x3"][0].reshape(3, 3).T, heaps.QUARTER_TURN)
    written = {"log": "TextLog:text", "silhouette": "EncodedImage:blob", ENTITY: "Clear:is_recursive"}
    for entity, component in written.items():
        assert [time for time, _ in component_rows(heap, entity, component)] == [20_000_000]
    static = {chunk.entity_path for chunk in read_chunks(heap) if chunk.is_static}
    assert "/world/walls/plate" in static
    assert "/" + ENTITY not in static


def test_every_grain_is_either_in_the_bed_or_mobile(tmp_path: Path):
    path = tmp_path / "heap.rrd"
    with heaps.recorded(path, heaps.header()) as recording:
        for frame in range(2 * stream.REWRITE_INTERVAL):
            restless = heaps.moved(heaps.heap_snapshot(frame), frame, speed=3.0 * heaps.MOVING)
            stream.log_frame(recording, restless, heaps.MOVING)
    for frame in read_grains(path):
        np.testing.assert_array_equal(frame.ident, heaps.heap_snapshot().ident)


def test_a_creeping_grain_is_never_shown_further_away_than_the_creep_allowed(tmp_path: Path):
    path = tmp_path / "heap.rrd"
    crept = [heaps.moved(heaps.heap_snapshot(3), 7, 3e-6 * frame) for frame in range(40)]
    with heaps.recorded(path, heaps.header()) as recording:
        for frame, snapshot in enumerate(crept):
            stream.log_frame(recording, replace(snapshot, time=0.01 * frame), heaps.MOVING)
    largest = stream.CREEP * heaps.heap_snapshot().radius[7]
    shown = np.array([frame.position[7, 0] for frame in read_grains(path)])
    # 1e-9 m: single precision at a millimetre
    assert np.abs(shown - [snapshot.position[7, 0] for snapshot in crept]).max() <= largest + 1e-9


def test_the_file_takes_its_name_only_when_it_is_whole(tmp_path: Path):
    path = tmp_path / "new" / "heap.rrd"
    recording = stream.open_recording(path, heaps.header())
    stream.log_frame(recording, heaps.heap_snapshot(), heaps.MOVING)
    assert not path.exists()
    assert stream.close(recording) == path
    assert [entry.name for entry in path.parent.iterdir()] == ["heap.rrd"]
    assert stream.close(recording) == path
    with pytest.raises(BadInput, match=r"next\.rrd: its folder cannot be made"):
        stream.open_recording(path / "next.rrd", heaps.header())
