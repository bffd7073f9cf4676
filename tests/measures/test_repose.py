"""The angle of heaps that were built with a known one."""

from math import cos, degrees, isnan, radians, sin, tan

import numpy as np
import pytest

from taichi_erosion.measures.repose import cone_angle, repose_angle
from tests.measures.heaps import DIAMETER, cone, packing, skirt, snapshot_of

RADIUS = 22.0  # diameters, of the cones below
EMPTY = snapshot_of(np.zeros((0, 3)))


def half_a_grain(angle, radius=RADIUS):
    """Half a diameter over the horizontal length 0.6 R of the fitted flank, as an angle [deg]."""
    return degrees(0.5 / (0.6 * radius)) * cos(radians(angle)) ** 2


@pytest.mark.parametrize("angle", [20.0, 25.0, 30.0, 35.0, 40.0])
def test_a_cone_of_grains_shows_its_angle(angle):
    heap = snapshot_of(cone(angle))
    silhouette, height_map = repose_angle(heap), cone_angle(heap)
    # 24 flanks and 13 rings average the grains: a third of what half a grain does to a single flank
    assert silhouette.value == pytest.approx(angle, abs=half_a_grain(angle) / 3)
    assert height_map.value == pytest.approx(angle, abs=half_a_grain(angle) / 3)
    assert silhouette.details["flags"] == []
    assert silhouette.details["residual"] < 0.5


def test_the_fitted_lines_lie_on_the_heap_they_were_fitted_to():
    moved = cone(30.0) + np.array((0.03, -0.02, 0.05))
    for azimuth, u, z, u_end, z_end in repose_angle(snapshot_of(moved), base_height=0.05).details["lines"]:
        axis = 0.03 * cos(radians(azimuth)) - 0.02 * sin(radians(azimuth))
        for across, height in ((u - axis, z), (u_end - axis, z_end)):
            surface = tan(radians(30.0)) * (RADIUS * DIAMETER - abs(across)) + DIAMETER
            assert height == pytest.approx(surface, abs=DIAMETER)


def test_a_monolayer_of_rolled_off_grains_is_not_flank():
    small = cone(25.0, radius=9.0)  # 15 % of its height is less than one grain
    lonely, dressed = snapshot_of(small), snapshot_of(np.vstack([small, skirt(8.5, 16.0)]))
    assert dressed.radius.size > 1.3 * lonely.radius.size
    for measure in (repose_angle, cone_angle):
        # the skirt can only fill the columns at the very foot: less than one column of grains per flank
        assert measure(dressed).value == pytest.approx(measure(lonely).value, abs=half_a_grain(25.0, 9.0))


def test_a_truncated_cone_keeps_its_flank_angle_and_is_flagged_as_are_few_short_flanks():
    measured = repose_angle(snapshot_of(cone(32.0, top=8.0)))
    assert measured.value == pytest.approx(32.0, abs=half_a_grain(32.0))
    assert measured.details["flags"] == ["flat_top"]
    assert any("truncated cone" in note for note in measured.notes)
    # 0.6 R is the length of a flank: at R = 5 d about half of them are shorter than three diameters
    small = repose_angle(snapshot_of(cone(25.0, radius=5.0)))
    assert 6 < small.details["short_flanks"] < 24
    assert small.details["flags"] == ["few_points"]


@pytest.mark.parametrize(("power", "sign"), [(2.0, 1.0), (0.5, -1.0)], ids=["hollow", "domed"])
def test_a_flank_that_is_not_straight_is_flagged(power, sign):
    centres = packing(16.0, 12.0, np.random.default_rng(6))
    share = np.clip(1.0 - np.hypot(centres[:, 0], centres[:, 1]) / 16.0, 0.0, None)
    inside = centres[:, 2] <= 12.0 * share**power
    measured = repose_angle(snapshot_of(centres[inside] * DIAMETER))
    assert "curved" in measured.details["flags"]
    assert measured.details["bend"] * sign > 5.0


def test_a_pile_cut_by_its_plate_is_flagged_and_grains_that_fell_off_are_counted_not_measured():
    centres = cone(30.0)
    plate = 15.0 * DIAMETER
    on_plate = centres[np.hypot(centres[:, 0], centres[:, 1]) < plate]
    assert "truncated_by_plate" in repose_angle(snapshot_of(on_plate), plate).details["flags"]
    assert repose_angle(snapshot_of(centres), plate_radius=30.0 * DIAMETER).details["flags"] == []
    fallen = np.column_stack([np.full((50, 2), 0.1), np.full(50, -0.2)])
    alone, both = repose_angle(snapshot_of(centres)), repose_angle(snapshot_of(np.vstack([centres, fallen])))
    assert both.details["fallen_grains"] == 50
    assert both.value == alone.value


@pytest.mark.parametrize(
    ("heap", "reason"),
    [
        (EMPTY, "no grains"),
        (snapshot_of(np.array([[0.0, 0.0, 1e-3]])), "no heap"),
        (snapshot_of(skirt(0.0, 12.0)), "no heap"),
        (snapshot_of(np.array([[0.0, np.nan, 1e-3]])), "not finite"),
        (snapshot_of(cone(30.0) - np.array((0.0, 0.0, 1.0))), "no grains above the base"),
    ],
    ids=["empty", "one grain", "one layer", "nan", "under the plate"],
)
def test_no_heap_gives_no_angle_and_says_why(heap, reason):
    measured = repose_angle(heap)
    assert isnan(measured.value)
    assert reason in measured.notes[0]
    assert isnan(cone_angle(heap).value)
