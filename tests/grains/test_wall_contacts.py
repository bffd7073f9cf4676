"""Grains on floors, meshes and walls that move or vanish."""

import numpy as np
import pytest
from few_grains import ARM, BELT_SPEED, INTERVAL, REMOVAL, TURN
from grain_worlds import FRICTION, GRAVITY, RADIUS, TIME_STEP

SLIDING = 2  # snapshot, at 4 ms, at which every dragged grain still slides: it rolls after 2 U / (7 mu g)
SPEED_GAINED = FRICTION * GRAVITY * SLIDING * INTERVAL  # m s-1


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


def test_a_turntable_drags_a_grain_along_with_the_sliding_friction(records):
    # while it slides, friction is mu m g against the slip; the grain's spin and its small drift turn that
    # direction by (v t / ARM) < 1 %; engaging the spring costs one step in a hundred
    state = records["turntable"].frames[SLIDING]
    assert state.velocity[0, 1] == pytest.approx(SPEED_GAINED, rel=2e-2)
    assert abs(state.velocity[0, 0]) < 2e-2 * SPEED_GAINED
    assert TURN * ARM > 3.5 * SPEED_GAINED


def test_a_turning_drum_drags_the_grain_at_its_bottom(records):
    # the wall passes below with spin x radius, here towards -x; the slope climbed meanwhile is below 1 %
    state = records["drum"].frames[SLIDING]
    assert state.velocity[0, 0] == pytest.approx(-SPEED_GAINED, rel=2e-2)


def test_removing_the_floor_lets_its_grains_fall_freely(records):
    frames = records["removed"].frames
    before, after = frames[REMOVAL], frames[-1]
    time = after.time - before.time
    assert before.contacts.tolist() == [1, 1]
    assert after.contacts.tolist() == [0, 0]
    fallen = before.position[:, 2] - after.position[:, 2]
    # the grains breathe on the floor with less than a step's worth of gravity: g dt t
    assert fallen == pytest.approx(0.5 * GRAVITY * time**2 * np.ones(2), abs=GRAVITY * TIME_STEP * time)
