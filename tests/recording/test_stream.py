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
    pyramid,
    read_frames,
    read_properties,
    read_series,
    record_heap,
    recorded,
    totals,
)

from taichi_erosion.core.errors import BadInput
from taichi_erosion.recording.blueprint import choose_focus, heap_focus
from taichi_erosion.recording.readback import read_chunks, read_grains, read_rows
from taichi_erosion.recording.stream import (
    CREEP,
    REWRITE_INTERVAL,
    StaticGrains,
    close,
    is_static,
    log_frame,
    log_image,
    log_text,
    log_wall_pose,
    log_wall_removed,
    open_recording,
    set_properties,
    update_static_grains,
)
from taichi_erosion.recording.wall_mesh import WallMesh


def test_the_state_of_effects_is_recorded_beside_the_grains(tmp_path: Path):
    path, bare = tmp_path / "heap.rrd", heap_snapshot()
    evolved = replace(bare, effect_state={"surface_crust.calm": np.linspace(-1.0, 1.0, len(bare.radius))})
    with recorded(path, header()) as recording:
        log_frame(recording, evolved, MOVING)
    parts = [read_rows(path, f"world/{part}", "ident", "surface_crust_calm")[0] for part in ("bed", "mobile")]
    ident, calm = (np.concatenate([part[column] for part in parts]) for column in (1, 2))
    np.testing.assert_array_equal(
        calm[np.argsort(ident)], np.linspace(-1.0, 1.0, len(ident)).astype(np.float32)
    )


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
            log_frame(recording, type(snapshot)(**{**vars(snapshot), "time": 0.01 * frame}), MOVING)
    largest = CREEP * heap_snapshot().radius[7]
    shown = np.array([frame.position[7, 0] for frame in read_grains(path)])
    # 1e-9 m: single precision at a millimetre
    assert np.abs(shown - [snapshot.position[7, 0] for snapshot in crept]).max() <= largest + 1e-9


def test_a_resting_bed_is_written_once_while_mobile_grains_are_written_every_frame(tmp_path: Path):
    path = tmp_path / "heap.rrd"
    record_heap(path, frames=10)
    # frame 0: the last grain has no speed yet and counts as resting; it leaves the bed at the next frame
    assert [len(positions) for _, positions in read_frames(path, "world/bed")] == [205, 204]
    assert [len(positions) for _, positions in read_frames(path, "world/mobile")] == [0] + [1] * 9


def test_the_ledger_is_read_back_as_curves_and_energies_also_in_decades(tmp_path: Path):
    path = tmp_path / "heap.rrd"
    record_heap(path, frames=20)
    times, contacts = read_series(path, "ledger/contacts")
    np.testing.assert_allclose(times, [totals(frame).time for frame in range(20)], atol=1e-9)
    np.testing.assert_array_equal(contacts, [totals(frame).contacts for frame in range(20)])
    # one rounding of 10 ** x and one of its logarithm
    np.testing.assert_allclose(
        read_series(path, "decades/kinetic_translation")[1], -0.1 * np.arange(20), atol=1e-15
    )


def test_an_energy_of_zero_has_no_decade(tmp_path: Path):
    path = tmp_path / "heap.rrd"
    record_heap(path)
    assert len(read_series(path, "ledger/kinetic_rotation")[0]) == 5
    assert len(read_series(path, "decades/kinetic_rotation")[0]) == 0


def test_properties_are_read_back_and_those_without_a_value_are_left_out(tmp_path: Path):
    path = tmp_path / "heap.rrd"
    with recorded(path, header()) as recording:
        log_frame(recording, heap_snapshot(), MOVING)
        set_properties(recording, "doe", {"contact.soil-soil.friction_rolling": 0.3})
        set_properties(recording, "result", {"repose_angle": 33.5, "flag": None, "n": 3, "straight": True})
    assert read_properties(path) == {
        "doe": {"contact.soil-soil.friction_rolling": 0.3},
        "result": {"repose_angle": 33.5, "n": 3, "straight": True},
    }


def test_only_simulated_time_and_steps_are_recorded(tmp_path: Path):
    path = tmp_path / "heap.rrd"
    record_heap(path)
    timelines = {name for chunk in read_chunks(path) for name in chunk.timeline_names}
    assert timelines == {"sim_time", "step"}


def test_the_recording_carries_its_blueprint_and_its_names(tmp_path: Path):
    from rerun.chunk import RrdReader

    record_heap(tmp_path / "heap.rrd")
    reader = RrdReader(tmp_path / "heap.rrd")
    (recording,) = reader.recordings()
    assert (recording.application_id, recording.recording_id) == ("taichi_erosion", "test-run")
    assert len(reader.blueprints()) == 1


def test_two_recordings_of_one_process_keep_apart(tmp_path: Path):
    with recorded(tmp_path / "a.rrd", header()) as a, recorded(tmp_path / "b.rrd", header()) as b:
        log_frame(a, heap_snapshot(0), MOVING)
        log_frame(b, heap_snapshot(5), MOVING)
    assert [frame.time for frame in read_grains(tmp_path / "a.rrd")] == [0.0]
    assert [frame.time for frame in read_grains(tmp_path / "b.rrd")] == pytest.approx([0.05])


def test_the_file_takes_its_name_only_when_it_is_whole(tmp_path: Path):
    path = tmp_path / "new" / "heap.rrd"
    recording = open_recording(path, header())
    log_frame(recording, heap_snapshot(), MOVING)
    assert not path.exists()
    assert close(recording) == path
    assert [entry.name for entry in path.parent.iterdir()] == ["heap.rrd"]
    assert close(recording) == path


@pytest.mark.parametrize("end", [KeyboardInterrupt, ValueError])
def test_an_interrupted_run_leaves_a_whole_recording(tmp_path: Path, end: type[BaseException]):
    path = tmp_path / "heap.rrd"

    def run() -> None:
        with recorded(path, header()) as recording:
            log_frame(recording, heap_snapshot(), MOVING)
            raise end

    with pytest.raises(end):
        run()
    assert len(read_grains(path)) == 1


def test_a_folder_that_cannot_be_made_is_named_in_one_line(tmp_path: Path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(BadInput, match=r"heap\.rrd: its folder cannot be made"):
        open_recording(tmp_path / "file" / "heap.rrd", header())


def test_a_wall_that_is_taken_away_is_cleared_at_that_time(tmp_path: Path):
    path, tube = tmp_path / "heap.rrd", WallMesh("lifting tube", FLOOR.vertices, FLOOR.triangles, moving=True)
    run = type(header())(**{**vars(header()), "walls": (FLOOR, tube)})
    with recorded(path, run) as recording:
        log_frame(recording, heap_snapshot(1), MOVING)
        log_wall_pose(recording, "lifting tube", (0.0, 0.0, 0.01), (sqrt(0.5), 0.0, 0.0, sqrt(0.5)))
        log_frame(recording, heap_snapshot(2), MOVING)
        log_wall_removed(recording, "lifting tube")
    entity = "world/walls/lifting\\ tube"
    ((_, quaternion),) = read_rows(path, entity, "Transform3D:quaternion")
    # rerun stores x, y, z, w in single precision
    np.testing.assert_allclose(quaternion[0], [0.0, 0.0, sqrt(0.5), sqrt(0.5)], rtol=1e-7)
    assert [time for time, _ in read_rows(path, entity, "Clear:is_recursive")] == [20_000_000]
    static = {chunk.entity_path for chunk in read_chunks(path) if chunk.is_static}
    assert "/world/walls/plate" in static
    assert "/" + entity not in static


def test_texts_and_pictures_are_kept_at_the_time_of_the_frame_before(tmp_path: Path):
    path = tmp_path / "heap.rrd"
    with recorded(path, header()) as recording:
        log_frame(recording, heap_snapshot(2), MOVING)
        log_text(recording, "WARN", "the heap is truncated by the plate")
        log_image(recording, "silhouette", np.zeros((20, 30, 3), dtype=np.uint8))
    ((text_time, _),) = read_rows(path, "log", "TextLog:text")
    ((image_time, _),) = read_rows(path, "silhouette", "EncodedImage:blob")
    assert (text_time, image_time) == (20_000_000, 20_000_000)


def test_the_camera_frames_the_heap_that_the_grains_will_form():
    radii = np.full(len(pyramid()), 1e-3)
    focus = heap_focus(radii, (0.01, 0.0, 0.1))
    assert focus.centre[:2] == (0.01, 0.0)
    # eight times the volume makes a heap twice as wide
    assert heap_focus(2.0 * radii, (0.0, 0.0, 0.0)).radius == pytest.approx(2.0 * focus.radius, rel=1e-12)
    assert choose_focus("drum", radii, (FLOOR,)).radius == pytest.approx(0.05 * sqrt(2.0))


FALLING = len(heap_snapshot().ident) - 1  # row of the grain in the air


def settled() -> StaticGrains:
    """The bed of the heap while its last grain falls."""
    static_grains, is_new = update_static_grains(StaticGrains.empty(), heap_snapshot(3), MOVING)
    assert is_new
    return static_grains


def test_the_first_bed_holds_every_grain_but_the_falling_one():
    assert settled().ident.tolist() == list(range(FALLING))


def test_a_heap_at_rest_is_not_written_again_until_its_turn():
    static_grains, written = settled(), []
    for _ in range(REWRITE_INTERVAL):
        static_grains, is_new = update_static_grains(static_grains, heap_snapshot(3), MOVING)
        written.append(is_new)
    assert written == [False] * (REWRITE_INTERVAL - 1) + [True]


def test_a_grain_that_starts_to_move_leaves_the_bed_at_once():
    static_grains, is_new = update_static_grains(
        settled(), moved(heap_snapshot(3), 7, speed=2.0 * MOVING), MOVING
    )
    assert is_new
    assert 7 not in static_grains.ident


def test_a_grain_that_creeps_slowly_leaves_the_bed_once_it_has_gone_far():
    radius = heap_snapshot().radius[7]
    near, _ = update_static_grains(
        settled(), moved(heap_snapshot(3), 7, distance=0.9 * CREEP * radius), MOVING
    )
    far, _ = update_static_grains(
        settled(), moved(heap_snapshot(3), 7, distance=1.1 * CREEP * radius), MOVING
    )
    assert 7 in near.ident
    assert 7 not in far.ident


def test_a_grain_that_came_to_rest_stays_mobile_until_the_bed_is_due():
    static_grains = settled()
    landed = moved(heap_snapshot(0), FALLING)
    for _ in range(REWRITE_INTERVAL - 1):
        static_grains, _ = update_static_grains(static_grains, landed, MOVING)
        assert not is_static(static_grains, landed)[FALLING]
    static_grains, _ = update_static_grains(static_grains, landed, MOVING)
    assert is_static(static_grains, landed)[FALLING]


def test_grains_that_are_released_later_do_not_disturb_the_bed():
    full = heap_snapshot(3)
    names = ("position", "velocity", "spin", "radius", "mass", "contacts", "ident")
    first = type(full)(**{**vars(full), **{name: getattr(full, name)[:50] for name in names}})
    static_grains, _ = update_static_grains(StaticGrains.empty(), first, MOVING)
    static_grains, is_new = update_static_grains(static_grains, full, MOVING)
    assert not is_new
    np.testing.assert_array_equal(np.flatnonzero(is_static(static_grains, full)), np.arange(50))
