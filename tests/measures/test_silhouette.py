"""Drawing spheres, cleaning a picture, and reading its upper edge."""

from math import cos, pi, sin

import numpy as np
import pytest

from taichi_erosion.measures.silhouette import draw_silhouette, extract_outline, fill_discs, largest_body


def test_discs_are_drawn_as_a_pixel_by_pixel_search_finds_them():
    rng = np.random.default_rng(3)
    rows, columns = 40, 60
    discs = np.stack([rng.uniform(-5, 65, 50), rng.uniform(-5, 45, 50), rng.uniform(1, 6, 50)])
    drawn = fill_discs(discs, (rows, columns))
    across, up = np.arange(columns) + 0.5, np.arange(rows) + 0.5
    x, y, r = (row[:, np.newaxis, np.newaxis] for row in discs)
    distance = np.abs(up[:, np.newaxis] - y) - np.sqrt(np.clip(r**2 - (across - x) ** 2, 0, None))
    seen = np.abs(across - x) <= r
    # a pixel whose centre is covered is drawn; one drawn has a span within half a pixel of its centre
    assert not (~drawn & ((distance <= 0.0) & seen).any(axis=0)).any()
    assert not (drawn & ~((distance < 0.5) & seen).any(axis=0)).any()


def test_a_sphere_casts_a_disc_of_its_radius_wherever_the_camera_stands():
    position, radius, diameter = np.array([[3e-3, -4e-3, 2e-3]]), np.array([1e-3]), 2e-3
    for azimuth in (0.0, 0.7, 2.0):
        picture = draw_silhouette(position, radius, azimuth, 0.0, diameter)
        covered = np.flatnonzero(picture.image.any(axis=0))
        middle = picture.left + (covered.mean() + 0.5) * picture.pixel
        assert middle == pytest.approx(3e-3 * cos(azimuth) - 4e-3 * sin(azimuth), abs=picture.pixel)
        # outward rounding adds up to one pixel above and below each of the eight columns
        assert pi / 4 <= picture.image.sum() / 8**2 <= pi / 4 + 2 / 8


def test_one_distant_runaway_does_not_coarsen_the_picture():
    rng = np.random.default_rng(4)
    heap = np.vstack([rng.uniform(-0.01, 0.01, (500, 3)), [[50.0, 0.0, 1e-3]]])
    picture = draw_silhouette(heap, np.full(501, 1e-3), 0.0, 0.0, 2e-3)
    assert picture.pixel == pytest.approx(2e-3 / 8)
    assert picture.image.shape[1] * picture.pixel < 0.06


def test_a_grain_thrown_far_up_coarsens_the_picture_instead_of_filling_the_memory():
    heap = np.array([[0.0, 0.0, 1e-3], [2e-3, 0.0, 1e-3], [0.0, 0.0, 1e3]])
    picture = draw_silhouette(heap, np.full(3, 1e-3), 0.0, 0.0, 2e-3)
    assert picture.image.size < 5_000_000


def test_detached_specks_vanish_and_holes_close():
    image = np.zeros((20, 30), dtype=bool)
    image[8:20, 5:20] = True
    image[12:15, 9:12] = False
    image[2:4, 24:26] = True
    body = largest_body(image)
    assert body[12:15, 9:12].all()
    assert not body[2:4, 24:26].any()


def test_an_empty_picture_has_no_body():
    assert not largest_body(np.zeros((5, 5), dtype=bool)).any()


def test_the_outline_is_the_top_of_each_column_seen_from_the_median_column():
    body = np.array([[0, 0, 0, 0, 0], [0, 0, 1, 0, 0], [0, 1, 1, 1, 0], [0, 1, 0, 1, 0]], dtype=bool)
    outline = extract_outline(body, 0.5)
    assert outline.height.tolist() == [0.0, 1.0, 1.5, 1.0, 0.0]
    assert outline.position.tolist() == [-1.0, -0.5, 0.0, 0.5, 1.0]
