"""Base lines of drawn heaps: their tilt and level, with plates, strips of plates, and none."""

from math import cos, radians, sin, tan

import numpy as np
import pytest

from taichi_erosion.measures.base_line import LARGEST_TILT, Turn, find_base_line

ROWS, COLUMNS, LEVEL = 400, 600, 330


def scene(tilt: float, plate: str, angle: float = 34.0, half: float = 190.0):
    """Binary picture of a cone on a plate to the lower frame, on a strip, or on nothing."""
    row, column = np.mgrid[0:ROWS, 0:COLUMNS] + 0.5
    c, s = cos(radians(tilt)), sin(radians(tilt))
    across = (column - 0.5 * COLUMNS) * c + (row - LEVEL) * s
    up = (column - 0.5 * COLUMNS) * s - (row - LEVEL) * c
    heap = (up > 0.0) & (up < tan(radians(angle)) * (half - np.abs(across)))
    return heap | {"whole": up <= 0.0, "strip": (up <= 0.0) & (up > -15.0), "none": False}[plate]


@pytest.mark.parametrize("plate", ["whole", "strip", "none"])
@pytest.mark.parametrize("tilt", [-12.0, -3.0, 0.0, 0.7, 6.0])
@pytest.mark.parametrize("angle", [12.0, 34.0])
def test_the_tilt_of_the_base_line_is_found(plate, tilt, angle):
    found = find_base_line(scene(tilt, plate, angle))
    # the ends of a line through 100 columns or more are known to half a pixel: 0.3 deg at worst
    assert found.tilt == pytest.approx(tilt, abs=0.3)
    assert found.row == pytest.approx(LEVEL, abs=3.0)


def test_a_flank_is_no_base_line_and_what_fills_the_picture_has_none():
    cut = scene(0.0, "none")[:LEVEL]  # the foot is the lower edge of the picture
    assert find_base_line(cut) is None
    assert find_base_line(np.zeros((50, 50), dtype=bool)) is None
    steep = find_base_line(scene(LARGEST_TILT + 10.0, "whole"))
    assert steep is None or abs(steep.tilt) <= LARGEST_TILT + 1.0


def test_points_of_a_turned_picture_are_found_in_the_picture_again():
    turn = Turn(8.0, (ROWS, COLUMNS))
    picture = np.zeros((ROWS, COLUMNS))
    picture[100, 450] = 1.0
    turned = turn.picture(picture)
    row, column = np.unravel_index(int(np.argmax(turned)), turned.shape)
    assert turn.back(np.array([column + 0.5, row + 0.5])) == pytest.approx([450.5, 100.5], abs=1.0)


def test_a_turned_picture_has_a_level_base_line():
    turned = Turn(6.0, (ROWS, COLUMNS)).picture(scene(6.0, "strip").astype(float)) > 0.5
    assert find_base_line(turned).tilt == pytest.approx(0.0, abs=0.15)
