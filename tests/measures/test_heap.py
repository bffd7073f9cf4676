"""The angle of heaps that were built with a known one; the definitions of lab_C on heaps reckoned by hand."""

from math import atan, cos, degrees, isnan, radians, sin, tan

import numpy as np
import pytest

from taichi_erosion.measures import heap
from taichi_erosion.measures.heap import cone_angle, repose_angle
from tests.measures.heaps import DIAMETER, cone, packing, skirt, snapshot_of

MEASURES = [heap.pile_height, heap.centroid_height, heap.settled_column_height, heap.radius_90]
MEASURES += [heap.runout_radius, heap.angle_of_repose_outline]
RADIUS = 22.0  # diameters, of the cones
EMPTY = snapshot_of(np.zeros((0, 3)))


def grains(*centres):
    return snapshot_of(np.array(centres, dtype=float) * DIAMETER)


def stack(*heights):
    """One column of grains with these centre heights in diameters."""
    return grains(*((0.0, 0.0, height) for height in heights))


@pytest.mark.parametrize(
    ("measured", "diameters"),
    [
        (heap.pile_height(stack(1, 9, 2, 3, 8, 4, 1)), (9 + 8 + 4 + 3 + 2 + 2.5) / 5),  # mean top of five
        (heap.centroid_height(stack(1, 2, 6), base_height=DIAMETER), 2.0),  # mean centre above the base
        (heap.settled_column_height(stack(*range(1, 60))), (59 + 58 + 1) / 2),  # of int(0.05 * 59) = 2 grains
    ],
    ids=lambda part: getattr(part, "name", ""),
)
def test_heights_are_means_of_the_highest_tops_or_of_all_centres(measured, diameters):
    assert measured.value == pytest.approx(diameters * DIAMETER)


def test_the_radius_of_90_percent_counts_from_zero_about_the_median_axis():
    line = [(7.0 + side * k, 3.0, 0.5) for k in range(1, 11) for side in (-1, 1)]
    # 20 distances 1, 1, 2, 2, .. 10, 10 diameters: number int(18.0), counted from 0, is the first 10
    assert heap.radius_90(grains(*line)).value == pytest.approx(10 * DIAMETER)


def test_the_runout_is_where_the_ring_height_falls_through_one_diameter():
    tower = [(0.0, 0.0, z) for z in (0.5, 1.5, 2.5)]
    diagonal = 1.5 / 2**0.5
    ring = [(x, y, 1.5) for x in (-diagonal, diagonal) for y in (-diagonal, diagonal)]
    runaway = [(2.5, 0.0, 0.5)]
    # ring heights: 3 d; 2 d in all 4 sectors; 1 d in one of 7 sectors
    expected = 1.5 + (2 - 1) / (2 - 1 / 7)
    assert heap.runout_radius(grains(*tower, *ring, *runaway)).value == pytest.approx(expected * DIAMETER)


def prose_angle(snapshot):
    """The definition of lab_C, read sentence by sentence and written with plain loops [deg]."""
    x, y, z = snapshot.position.T
    d = 2 * snapshot.radius[0]
    top = z + d / 2
    height = np.mean(sorted(top)[-5:])
    low = max(0.15 * height, 1.25 * d)
    values = []
    for azimuth in range(0, 180, 15):
        along = (x - np.median(x)) * cos(radians(azimuth)) + (y - np.median(y)) * sin(radians(azimuth))
        two = []
        for side in (along, -along):
            bins = []
            for k in range(1000):
                here = top[(side >= k * d) & (side < (k + 1) * d)]
                if len(here) == 0 or here.max() < low:
                    break
                if here.max() <= 0.75 * height:
                    bins.append((k * d, here.max()))
            if len(bins) >= 3:
                two.append(degrees(atan(-np.polyfit(*np.transpose(bins), 1)[0])))
        if two:
            values.append(np.mean(two))
    return np.mean(values)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_outline_angle_follows_the_prose_of_the_laboratory(seed):
    built = np.vstack([cone(24.0, radius=13.0, seed=seed), skirt(12.0, 18.0, seed)])
    shift = np.random.default_rng(seed).normal(size=3)
    measured = heap.angle_of_repose_outline(snapshot_of(built + shift), base_height=shift[2])
    # lengths of 1 m added and taken away again leave errors of 1e-16 m on 1e-3 m
    assert measured.value == pytest.approx(prose_angle(snapshot_of(built)), abs=1e-6)


def test_the_grain_diameter_halves_the_volume_not_the_number():
    sizes = np.array([1.0] * 100 + [10.0])  # 100 against 1000 parts of volume
    assert heap.median_diameter_by_volume(snapshot_of(np.zeros((101, 3)), sizes)) == 10.0


@pytest.mark.parametrize("measure", MEASURES)
def test_no_grains_give_no_value(measure):
    measured = measure(EMPTY)
    assert isnan(measured.value)
    assert measured.notes == ("no grains",)


def half_a_grain(angle, radius=RADIUS):
    """Half a diameter over the horizontal length 0.6 R of the fitted flank, as an angle [deg]."""
    return degrees(0.5 / (0.6 * radius)) * cos(radians(angle)) ** 2


@pytest.mark.parametrize("angle", [20.0, 25.0, 30.0, 35.0, 40.0])
def test_a_cone_of_grains_shows_its_angle(angle):
    built = snapshot_of(cone(angle))
    silhouette, height_map = repose_angle(built), cone_angle(built)
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
    measured = repose_angle(snapshot_of(centres[(centres[:, 2] <= 12.0 * share**power)] * DIAMETER))
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
    assert (both.details["fallen_grains"], both.value) == (50, alone.value)


@pytest.mark.parametrize(
    ("heap", "reason"),
    [
        (EMPTY, "no grains"),
        (snapshot_of(skirt(0.0, 12.0)), "no heap"),
        (snapshot_of(np.array([[0.0, np.nan, 1e-3]])), "not finite"),
        (snapshot_of(cone(30.0) - np.array((0.0, 0.0, 1.0))), "no grains above the base"),
    ],
    ids=["empty", "one layer", "nan", "under the plate"],
)
def test_no_heap_gives_no_angle_and_says_why(heap, reason):
    measured = repose_angle(heap)
    assert isnan(measured.value)
    assert reason in measured.notes[0]
    assert isnan(cone_angle(heap).value)
