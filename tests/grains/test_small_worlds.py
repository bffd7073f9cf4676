"""Few grains on moving walls, in the void and in periodic boxes; worlds that come to a bad end."""

import numpy as np
import pytest
from few_grains import ARM, BELT_SPEED, INTERVAL, INTERVALS, PERIOD, REMOVAL, TURN, WorldRecord, run_worlds
from grain_worlds import FRICTION, GRAVITY, RADIUS, TIME_STEP

from taichi_erosion.core.snapshot import Status

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
SLIDING = 2  # snapshot, at 4 ms, at which every dragged grain still slides: it rolls after 2 U / (7 mu g)
SPEED_GAINED = FRICTION * GRAVITY * SLIDING * INTERVAL  # m s-1


@pytest.fixture(scope="module")
def records() -> dict[str, WorldRecord]:
    return run_worlds()


def test_a_grain_rolling_over_coplanar_triangles_feels_the_plane(records):
    # the claim of the design; edges, corners and both orders of the corners lie under the track
    for on_plane, on_mesh in zip(records["plane"].frames, records["mesh"].frames, strict=True):
        assert np.abs(on_mesh.position - on_plane.position).max() < 1e-6 * RADIUS
        assert np.abs(on_mesh.spin - on_plane.spin).max() < 1e-6 * np.abs(on_plane.spin).max(initial=1.0)
    assert records["mesh"].frames[-1].position[0, 0] > 2.0 * 1.3e-3


def test_a_belt_carries_a_grain_until_it_rolls_at_two_sevenths_of_the_speed(records):
    # friction acts on the lowest point: m v R = (2/5) m R^2 w, and v + w R = U when sliding ends; the
    # tangential spring keeps mu F / k_t of slip, which the dashpot removes: some 1e-3 of U remains
    end = records["belt"].frames[-1]
    assert end.velocity[0, 0] == pytest.approx(2.0 / 7.0 * BELT_SPEED, rel=1e-2)
    assert end.spin[0, 1] * RADIUS == pytest.approx(-5.0 / 7.0 * BELT_SPEED, rel=1e-2)


def test_a_turntable_and_a_turning_drum_drag_a_grain_along_with_the_sliding_friction(records):
    # while it slides, friction is mu m g against the slip; the grain's spin and its small drift turn that
    # direction by (v t / ARM) < 1 %; engaging the spring costs one step in a hundred
    table, drum = (records[name].frames[SLIDING].velocity[0] for name in ("turntable", "drum"))
    assert TURN * ARM > 3.5 * SPEED_GAINED
    assert table[1] == pytest.approx(SPEED_GAINED, rel=2e-2)
    assert abs(table[0]) < 2e-2 * SPEED_GAINED
    # the wall passes below with spin x radius, here towards -x; the slope climbed meanwhile is below 1 %
    assert drum[0] == pytest.approx(-SPEED_GAINED, rel=2e-2)


def test_removing_the_floor_lets_its_grains_fall_freely(records):
    frames = records["removed"].frames
    before, after = frames[REMOVAL], frames[-1]
    time = after.time - before.time
    assert before.contacts.tolist() == [1, 1]
    assert after.contacts.tolist() == [0, 0]
    fallen = before.position[:, 2] - after.position[:, 2]
    # the grains breathe on the floor with less than a step's worth of gravity: g dt t
    assert fallen == pytest.approx(0.5 * GRAVITY * time**2 * np.ones(2), abs=GRAVITY * TIME_STEP * time)


def test_grains_enter_at_their_time_and_fall_from_there(records):
    record = records["released"]
    release = record.setup.grains.release_time
    for frame in record.frames:
        inside = release <= frame.time - TIME_STEP
        assert (frame.ident.tolist(), frame.waiting) == (np.flatnonzero(inside).tolist(), (~inside).sum())
    last = record.frames[-1]
    time = last.time - release
    # a late grain takes its first kick over a whole step, g dt t / 2 too far
    fallen = record.setup.grains.position[:, 2] - last.position[:, 2]
    assert fallen == pytest.approx(0.5 * GRAVITY * time**2, abs=GRAVITY * TIME_STEP * time.max())


def test_a_grain_meets_its_partner_across_the_edge_of_a_periodic_box_and_stays_inside(records):
    edge, middle = records["across the edge"].frames, records["in the middle"].frames
    assert np.linalg.norm(edge[-1].velocity - edge[0].velocity) > 0.05  # they have met
    for frame, other in zip(edge, middle, strict=True):
        assert frame.velocity == pytest.approx(other.velocity, abs=1e-9)
    places = np.stack([frame.position[:, 0] for frame in edge])
    assert places.min() >= 0.0
    assert places.max() < PERIOD
    assert np.abs(np.diff(places, axis=0)).max() > 0.5 * PERIOD  # one of them went through the edge


NAN = pytest.approx(np.nan, nan_ok=True)
ENDS = {  # status, grain, partner, value
    "runaway": (Status.LOST, 0, -1, pytest.approx(2e-3)),  # m, where the domain ends
    # (2 R - 1.2 R) / R before anything moves
    "inside each other": (Status.OVERLAP, 0, 1, pytest.approx(0.8)),
    "not a number": (Status.NOT_FINITE, 0, -1, NAN),
    "infinite": (Status.NOT_FINITE, 0, -1, NAN),
}


def test_worlds_that_go_wrong_stop_and_say_why_and_those_beside_them_go_on(records):
    for name, record in records.items():
        end, last = record.failure, record.frames[-1].time
        if name in ENDS:
            assert (end.status, end.grain, end.partner, end.value) == ENDS[name]
            assert last < INTERVALS * INTERVAL
        else:
            assert end is None
            assert last == pytest.approx(INTERVALS * INTERVAL, rel=1e-12)
