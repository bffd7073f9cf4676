"""The definitions of the laboratory set lab_C on configurations that can be reckoned by hand."""

from math import atan, cos, degrees, isnan, radians, sin

import numpy as np
import pytest

from taichi_erosion.measures import heap as heaps
from tests.measures.heaps import DIAMETER, cone, skirt, snapshot_of

MEASURES = [heaps.pile_height, heaps.centroid_height, heaps.column_height, heaps.radius_90]
MEASURES += [heaps.runout_radius, heaps.angle_of_repose_outline]


def grains(*centres):
    """A snapshot from centres in diameters."""
    return snapshot_of(np.array(centres, dtype=float) * DIAMETER)


def stack(*heights):
    """One column of grains with these centre heights in diameters."""
    return grains(*((0.0, 0.0, height) for height in heights))


@pytest.mark.parametrize(
    ("measured", "diameters"),
    [
        (heaps.pile_height(stack(1, 9, 2, 3, 8, 4, 1)), (9 + 8 + 4 + 3 + 2 + 2.5) / 5),  # mean top of five
        (heaps.centroid_height(stack(1, 2, 6), base_height=DIAMETER), 2.0),  # mean centre above the base
        (heaps.column_height(stack(*range(1, 60))), (59 + 58 + 1) / 2),  # of int(0.05 * 59) = 2 grains
    ],
    ids=lambda part: getattr(part, "name", ""),
)
def test_heights_are_means_of_the_highest_tops_or_of_all_centres(measured, diameters):
    assert measured.value == pytest.approx(diameters * DIAMETER)


def test_the_radius_of_90_percent_counts_from_zero_about_the_median_axis():
    line = [(7.0 + side * k, 3.0, 0.5) for k in range(1, 11) for side in (-1, 1)]
    # 20 distances 1, 1, 2, 2, .. 10, 10 diameters: number int(18.0), counted from 0, is the first 10
    assert heaps.radius_90(grains(*line)).value == pytest.approx(10 * DIAMETER)


def test_the_runout_is_where_the_ring_height_falls_through_one_diameter():
    tower = [(0.0, 0.0, z) for z in (0.5, 1.5, 2.5)]
    diagonal = 1.5 / 2**0.5
    ring = [(x, y, 1.5) for x in (-diagonal, diagonal) for y in (-diagonal, diagonal)]
    runaway = [(2.5, 0.0, 0.5)]
    # ring heights: 3 d; 2 d in all 4 sectors; 1 d in one of 7 sectors
    expected = 1.5 + (2 - 1) / (2 - 1 / 7)
    assert heaps.runout_radius(grains(*tower, *ring, *runaway)).value == pytest.approx(expected * DIAMETER)


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
    heap = np.vstack([cone(24.0, radius=13.0, seed=seed), skirt(12.0, 18.0, seed)])
    shift = np.random.default_rng(seed).normal(size=3)
    measured = heaps.angle_of_repose_outline(snapshot_of(heap + shift), base_height=shift[2])
    # lengths of 1 m added and taken away again leave errors of 1e-16 m on 1e-3 m
    assert measured.value == pytest.approx(prose_angle(snapshot_of(heap)), abs=1e-6)


def test_the_grain_diameter_halves_the_volume_not_the_number():
    sizes = np.array([1.0] * 100 + [10.0])  # 100 against 1000 parts of volume
    assert heaps.grain_diameter(snapshot_of(np.zeros((101, 3)), sizes)) == 10.0


@pytest.mark.parametrize("measure", MEASURES)
def test_no_grains_give_no_value(measure):
    measured = measure(snapshot_of(np.zeros((0, 3))))
    assert isnan(measured.value)
    assert measured.notes == ("no grains",)
