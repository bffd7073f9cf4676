from math import pi

import numpy as np
import pytest

from taichi_erosion.core.setup import PrimitiveKind
from taichi_erosion.recording.wall_mesh import SEGMENTS, WallMesh, triangulate, wall_cut_lines


def mesh(kind: PrimitiveKind, *numbers: float) -> WallMesh:
    shape = np.zeros(10)
    shape[: len(numbers)] = numbers
    return WallMesh("wall", *triangulate(kind, shape, ((-0.1, -0.2, 0.0), (0.3, 0.2, 0.5))), moving=False)


def area(wall: WallMesh) -> float:
    a, b, c = (wall.vertices[wall.triangles[:, corner]] for corner in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def test_a_level_floor_covers_the_bounds_exactly():
    floor = mesh(PrimitiveKind.PLANE, 9.0, 9.0, 0.1, 0.0, 0.0, 1.0)
    np.testing.assert_allclose(floor.vertices.min(axis=0), [-0.1, -0.2, 0.1], atol=1e-15)
    np.testing.assert_allclose(floor.vertices.max(axis=0), [0.3, 0.2, 0.1], atol=1e-15)
    assert area(floor) == pytest.approx(0.4 * 0.4)


@pytest.mark.parametrize("normal", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.0, 0.8), (0.48, 0.6, 0.64)])
def test_every_corner_of_a_plane_lies_in_it(normal: tuple[float, float, float]):
    point = np.array([0.05, 0.01, 0.2])
    plane = mesh(PrimitiveKind.PLANE, *point, *normal)
    np.testing.assert_allclose((plane.vertices - point) @ np.array(normal), 0.0, atol=1e-15)
    assert area(plane) > 0.0


def test_a_tube_has_the_area_of_its_polygon():
    radius, length = 0.04, 0.1
    tube = mesh(PrimitiveKind.REVOLVED, 0.0, 0.0, 0.02, 0.0, 0.0, 1.0, radius, 0.0, radius, length)
    chord = 2.0 * radius * np.sin(pi / SEGMENTS)
    assert area(tube) == pytest.approx(SEGMENTS * chord * length)
    np.testing.assert_allclose(np.hypot(*tube.vertices[:, :2].T), radius)
    assert (tube.vertices[:, 2].min(), tube.vertices[:, 2].max()) == pytest.approx((0.02, 0.12))


def test_the_cut_of_a_cone_is_its_profile_on_both_sides():
    cut = wall_cut_lines(mesh(PrimitiveKind.REVOLVED, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.01, 0.0, 0.05, 0.08))
    x, z = np.abs(cut[..., 0]), cut[..., 1]
    # the cut lies in the facets: inside the circle by at most the sagitta of a chord
    profile = 0.01 + 0.5 * z
    assert (x <= profile + 1e-15).all()
    assert (x >= profile * np.cos(pi / SEGMENTS) - 1e-15).all()
    length = np.linalg.norm(cut[:, 1] - cut[:, 0], axis=1).sum()
    assert length == pytest.approx(2.0 * np.hypot(0.04, 0.08), rel=1.0 - np.cos(pi / SEGMENTS))
