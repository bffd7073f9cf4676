"""The surface in a drum, and the tilt at which grains slide."""

from dataclasses import replace
from functools import cache
from math import cos, radians, sin, sqrt

import numpy as np
import pytest

from taichi_erosion.measures.drum_and_incline import angle_at_which_grains_slide, dynamic_angle
from tests.measures.heaps import DIAMETER, packing, snapshot_of

DRUM = 16.0 * DIAMETER


@cache
def packed(seed):
    """A box of grains as wide and high as the drum."""
    return packing(16.0, 32.0, np.random.default_rng(seed))


def drum(angle, seed=1, flying=0):
    """Half-filled drum about the y axis with a plane surface, some grains in flight above it."""
    rng = np.random.default_rng(seed)
    box = packed(seed) - (0.0, 0.0, 16.0)
    slope = radians(angle)
    inside = (np.hypot(box[:, 0], box[:, 2]) < 15.5) & (box[:, 2] * cos(slope) < box[:, 0] * sin(slope))
    bed = box[inside & (np.abs(box[:, 1]) < 6.0)]
    air = rng.uniform((3.0, -6.0, 8.0), (7.0, 6.0, 10.0), (flying, 3))
    contacts = np.repeat([4, 0], [len(bed), flying]).astype(np.int32)
    return snapshot_of(np.vstack([bed, air]) * DIAMETER, contacts=contacts)


@pytest.mark.parametrize("angle", [-27.0, 15.0, 35.0])
def test_the_surface_of_a_drum_shows_its_slope(angle):
    measured = dynamic_angle([drum(angle, seed) for seed in range(3)], DRUM)
    # bins of 12 slices: a tenth of a grain over the middle half of the drum
    assert measured.value == pytest.approx(abs(angle), abs=np.degrees(0.2 / 16.0))
    assert np.sign(measured.details["frame_angles"]).tolist() == [np.sign(angle)] * 3
    assert measured.n == 1


def test_grains_in_flight_do_not_belong_to_the_surface():
    quiet, busy = dynamic_angle([drum(20.0)], DRUM), dynamic_angle([drum(20.0, flying=60)], DRUM)
    assert busy.value == pytest.approx(quiet.value, abs=1e-9)


def test_the_drum_may_stand_anywhere_and_turn_about_any_level_axis():
    state = drum(25.0)
    x, y, z = state.position.T
    turned = replace(state, position=np.column_stack([y + 1.0, -x, z + 0.5]))
    measured = dynamic_angle([turned], DRUM, centre=(1.0, 0.0, 0.5), axis=(1.0, 0.0, 0.0))
    assert measured.value == pytest.approx(dynamic_angle([state], DRUM).value, abs=1e-6)


def sliding_series(displacements):
    """Frames of nine grains that moved by these shares of a diameter along x; one grain never moves."""
    start = np.random.default_rng(7).uniform(0.0, 0.05, (9, 3))
    loose = np.arange(9)[:, np.newaxis] > 0
    return [snapshot_of(start + loose * (share * DIAMETER, 0.0, 0.0)) for share in displacements]


def test_the_sliding_angle_is_interpolated_between_frames():
    tilts = np.radians([10.0, 11.0, 12.0, 13.0])
    measured = angle_at_which_grains_slide(sliding_series([0.0, 0.0, 0.2, 1.4]), tilts)
    # half a diameter is reached a quarter of the way from 0.2 to 1.4
    assert (measured.value, measured.sd) == (pytest.approx(12.25), pytest.approx(1.0 / sqrt(12.0)))
    assert measured.details["friction"] == pytest.approx(np.tan(radians(12.25)))
    assert [each.flag for each in measured.shortfalls] == ["fast_tilt"]  # a twentieth is reached at 11.25


def test_grains_that_enter_or_leave_do_not_count_as_moved():
    first, last = sliding_series([0.0, 0.1])
    fewer = replace(last, **{name: getattr(last, name)[2:] for name in ("position", "radius", "ident")})
    measured = angle_at_which_grains_slide([first, fewer], [0.0, 0.5], share=0.1 - 1e-6)
    assert measured.details["displacements"][1] == pytest.approx(0.1)
