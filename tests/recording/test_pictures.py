"""Grains from the side, silhouettes, films: where things are drawn, and in which colour."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from recorded_heaps import FLOOR, heap_snapshot, pyramid

from taichi_erosion.recording import pictures
from taichi_erosion.recording.wall_mesh import WallMesh

WINDOW = pictures.SideView((-0.02, 0.0), (0.02, 0.03), (320, 240))
SPEEDS = (1e-2, 2.0)
RADIUS = 5e-3  # m


def spheres(*centres: tuple[float, float, float], walls: tuple[WallMesh, ...] = ()) -> np.ndarray:
    places = np.array(centres).reshape(-1, 3)
    image = pictures.render_side(places, np.full(len(places), RADIUS), WINDOW, walls=walls)
    return np.asarray(image).astype(int)


def pixel(x: float, z: float) -> tuple[int, int]:
    column, row = np.rint(WINDOW.pixels(np.array([x, z]))).astype(int)
    return row, column


def test_a_sphere_is_a_disc_at_its_place_lit_from_the_upper_left():
    image = spheres((0.01, 0.0, 0.01))
    rows, columns = np.nonzero((image != spheres()).any(axis=-1))  # pixels that differ from an empty picture
    # every pixel that the edge touches counts: half a pixel more all around
    assert rows.size == pytest.approx(np.pi * (RADIUS * WINDOW.scale) ** 2, rel=2.0 / (RADIUS * WINDOW.scale))
    expected = WINDOW.pixels(np.array([0.01, 0.01]))
    # the disc is drawn on half pixels and covers whole ones
    np.testing.assert_allclose([columns.mean(), rows.mean()], expected, atol=0.5)
    row, column = pixel(0.01, 0.01)
    assert image[row - 20, column - 20].sum() > image[row + 20, column + 20].sum()


def test_the_nearer_of_two_spheres_hides_the_farther_whatever_their_order():
    places, radii = np.array([[0.0, -0.01, 0.01], [0.0, 0.01, 0.01]]), np.full(2, RADIUS)
    colours = np.array([[255, 0, 0], [0, 0, 255]], dtype=np.uint8)
    image = np.asarray(pictures.render_side(places, radii, WINDOW, colours))
    swapped = np.asarray(pictures.render_side(places[::-1], radii, WINDOW, colours[::-1]))
    np.testing.assert_array_equal(image, swapped)
    assert image[pixel(0.0, 0.01)][0] > image[pixel(0.0, 0.01)][2]


def test_a_grid_holds_the_silhouette_of_every_azimuth_with_its_flanks(tmp_path: Path):
    masks = [np.ones((30 + 2 * index, 100), dtype=bool) for index in range(7)]
    captions = [f"{30 * index}°" for index in range(7)]
    plain = pictures.silhouette_grid(masks, [np.empty((0, 2, 2))] * 7, captions)
    assert (np.asarray(plain) == pictures.SAND).all(axis=-1).sum() == sum(mask.sum() for mask in masks)
    lined = pictures.silhouette_grid(masks, [np.array([[[0.0, 20.0], [40.0, 0.0]]])] * 7, captions)
    red = np.asarray(lined).astype(int)
    assert (red[..., 0] - red[..., 1] > 100).sum() > 7 * 40
    assert lined.width > 300
    assert lined.height > 3 * (30 + pictures.HEADROOM)
    with Image.open(pictures.write_png(tmp_path / "grid.png", lined)) as written:
        assert written.size == lined.size


def test_a_film_has_one_picture_per_frame_and_the_same_frames_give_the_same_bytes(tmp_path: Path):
    def film() -> list[Image.Image]:
        return [pictures.film_frame(heap_snapshot(frame), WINDOW, (FLOOR,), SPEEDS) for frame in range(3)]

    first, again = (pictures.write_gif(tmp_path / name, film(), 0.08) for name in ("a.gif", "b.gif"))
    assert first.read_bytes() == again.read_bytes()
    assert pictures.png_bytes(film()[0]) == pictures.png_bytes(film()[0])
    with Image.open(first) as shown:
        assert (shown.n_frames, shown.size, shown.info["duration"]) == (3, WINDOW.size, 80)


def test_moving_grains_take_the_colour_of_their_speed():
    still = heap_snapshot()
    flying = replace(still, velocity=np.full_like(still.velocity, 2.0))
    at = pixel(*pyramid()[100, [0, 2]])
    sand, blue = (np.asarray(pictures.film_frame(state, WINDOW, (), SPEEDS))[at] for state in (still, flying))
    assert sand[0] > sand[2]
    assert blue[2] > blue[0]
    colours = pictures.speed_colours(np.array([1e-6, 1e-2, 0.02, 0.04, 0.32, 99.0]), 1e-2, 0.32)
    # equal ratios, the ends kept, truncation to whole levels
    np.testing.assert_allclose(colours, pictures.SPEED_COLOURS[[0, 0, 1, 2, 5, 5]], atol=1)
