from dataclasses import replace
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest
from recorded_heaps import FLOOR, heap_snapshot, pyramid

from taichi_erosion.recording import pictures
from taichi_erosion.recording.pictures import (
    HEADROOM,
    SideView,
    blank,
    distance_to_segment,
    draw_line,
    film_frame,
    lettering,
    render_side,
    silhouette_grid,
    silhouette_picture,
    write_gif,
    write_png,
)

WINDOW = SideView((-0.02, 0.0), (0.02, 0.03), (320, 240))
SPEEDS = (1e-2, 2.0)


def coloured(image: np.ndarray, view: SideView, background: np.ndarray | None = None) -> np.ndarray:
    """Pixels that differ from an empty picture."""
    empty = render_side(np.empty((0, 3)), np.empty(0), view) if background is None else background
    return (image != empty).any(axis=-1)


def test_a_sphere_covers_the_area_of_its_disc():
    radius = 5e-3
    image = render_side(np.array([[0.0, 0.0, 0.015]]), np.array([radius]), WINDOW)
    pixels = np.pi * (radius * WINDOW.scale) ** 2
    # every pixel that the edge touches counts: half a pixel more all around
    assert coloured(image, WINDOW).sum() == pytest.approx(pixels, rel=2.0 / (radius * WINDOW.scale))


def test_a_sphere_stands_where_its_centre_is():
    image = render_side(np.array([[0.01, 0.0, 0.005]]), np.array([2e-3]), WINDOW)
    rows, columns = np.nonzero(coloured(image, WINDOW))
    expected = WINDOW.pixels(np.array([0.01, 0.005]))
    # the disc is drawn on half pixels and covers whole ones
    np.testing.assert_allclose([columns.mean(), rows.mean()], expected, atol=0.5)


def test_the_nearer_of_two_spheres_hides_the_farther_whatever_their_order():
    positions, radii = np.array([[0.0, -0.01, 0.01], [0.0, 0.01, 0.01]]), np.array([4e-3, 4e-3])
    colours = np.array([[255, 0, 0], [0, 0, 255]], dtype=np.uint8)
    image = render_side(positions, radii, WINDOW, colours)
    swapped = render_side(positions[::-1], radii[::-1], WINDOW, colours[::-1])
    np.testing.assert_array_equal(image, swapped)
    column, row = np.rint(WINDOW.pixels(np.array([0.0, 0.01]))).astype(int)
    assert image[row, column, 0] > image[row, column, 2]


def test_light_falls_from_the_upper_left():
    image = render_side(np.array([[0.0, 0.0, 0.015]]), np.array([8e-3]), WINDOW).sum(axis=-1)
    column, row = np.rint(WINDOW.pixels(np.array([0.0, 0.015]))).astype(int)
    assert image[row - 30, column - 30] > image[row + 30, column + 30]


def test_grains_outside_the_window_are_cut_off():
    image = render_side(np.array([[0.0, 0.0, -0.02], [5.0, 0.0, 0.01]]), np.array([5e-3, 5e-3]), WINDOW)
    assert not coloured(image, WINDOW).any()


def test_walls_are_outlined_where_the_middle_plane_cuts_them():
    empty = render_side(np.empty((0, 3)), np.empty(0), WINDOW)
    image = render_side(np.empty((0, 3)), np.empty(0), WINDOW, walls=(FLOOR,))
    rows = np.unique(np.nonzero(coloured(image, WINDOW, empty))[0])
    assert rows.min() >= WINDOW.size[1] - 3


def test_a_silhouette_keeps_its_pixels_under_the_headroom():
    mask = np.tri(40, 90, dtype=bool)
    image = silhouette_picture(mask, np.empty((0, 2, 2)))
    assert image.shape == (40 + HEADROOM, 90, 3)
    np.testing.assert_array_equal((image[HEADROOM:] == pictures.SAND).all(axis=-1), mask)


def test_a_grid_holds_every_azimuth(tmp_path: Path):
    masks = [np.ones((30 + 2 * index, 100), dtype=bool) for index in range(7)]
    flanks = [np.array([[[0.0, 20.0], [40.0, 0.0]]])] * 7
    captions = [f"{30 * index}°" for index in range(7)]
    grid = silhouette_grid(masks, flanks, captions, columns=3)
    plain = silhouette_grid(masks, [np.empty((0, 2, 2))] * 7, columns=3)
    sand = (plain == pictures.SAND).all(axis=-1).sum()
    assert sand == sum(mask.sum() for mask in masks)
    shape = imageio.imread(write_png(tmp_path / "grid.png", grid)).shape
    assert shape == grid.shape
    assert shape[1] > 300
    assert shape[0] > 3 * (30 + HEADROOM)


def test_a_film_has_one_picture_per_frame_in_the_size_asked_for(tmp_path: Path):
    snapshots = [heap_snapshot(frame) for frame in range(4)]
    frames = [film_frame(snapshot, WINDOW, (FLOOR,), SPEEDS) for snapshot in snapshots]
    path = write_gif(tmp_path / "pour.gif", frames, frame_duration=0.08)
    assert imageio.imread(path, index=None).shape == (4, 240, 320, 3)
    assert imageio.immeta(path)["duration"] == 80


def test_the_same_pictures_give_the_same_bytes(tmp_path: Path):
    frames = [film_frame(heap_snapshot(frame), WINDOW, (FLOOR,), SPEEDS) for frame in range(3)]
    again = [film_frame(heap_snapshot(frame), WINDOW, (FLOOR,), SPEEDS) for frame in range(3)]
    assert (
        write_gif(tmp_path / "a.gif", frames).read_bytes()
        == write_gif(tmp_path / "b.gif", again).read_bytes()
    )
    assert (
        write_png(tmp_path / "a.png", frames[0]).read_bytes()
        == write_png(tmp_path / "b.png", again[0]).read_bytes()
    )


def test_moving_grains_take_the_colour_of_their_speed():
    still = heap_snapshot()
    flying = replace(still, velocity=np.full_like(still.velocity, 2.0))
    sand = film_frame(still, WINDOW, (), SPEEDS).astype(int)
    blue = film_frame(flying, WINDOW, (), SPEEDS).astype(int)
    column, row = np.rint(WINDOW.pixels(pyramid()[100, [0, 2]])).astype(int)
    assert sand[row, column, 0] > sand[row, column, 2]
    assert blue[row, column, 2] > blue[row, column, 0]


def test_colours_of_speed_run_in_equal_ratios_and_stay_at_their_ends():
    colours = pictures.speed_colours(np.array([1e-6, 1e-2, 0.02, 0.04, 0.32, 99.0]), 1e-2, 0.32)
    expected = pictures.SPEED_COLOURS[[0, 0, 1, 2, 5, 5]]
    # truncation to whole levels
    np.testing.assert_allclose(colours, expected, atol=1)


def test_the_distance_to_a_segment_is_that_to_its_ends_beyond_them():
    ends = np.array([[0.0, 0.0], [4.0, 0.0]])
    places = np.array([[2.0, 3.0], [7.0, 4.0], [-3.0, -4.0]])
    np.testing.assert_allclose(distance_to_segment(places, ends), [3.0, 5.0, 5.0])


def test_a_line_far_outside_leaves_the_image_alone():
    image = blank((20, 10), pictures.NIGHT, pictures.NIGHT)
    draw_line(image, np.array([[-50.0, -50.0], [-40.0, -60.0]]), pictures.CHALK)
    assert (image == pictures.NIGHT).all()


def test_no_two_letters_look_alike():
    stamps = {lettering(letter).tobytes() for letter in "0123456789.-+ °smu/="}
    assert len(stamps) == 20


def test_a_colour_bar_shows_every_colour_above_its_numbers():
    image = pictures.blank((260, 40), pictures.NIGHT, pictures.NIGHT)
    pictures.draw_speed_bar(image, (10, 4), (0.01, 2.0))
    bar = image[6, 10 : 10 + pictures.COLOUR_BAR[0]]
    assert tuple(bar[0]) == pictures.SAND
    assert tuple(bar[-1]) == tuple(pictures.SPEED_COLOURS[-1])
    below = image[4 + pictures.COLOUR_BAR[1] :]
    lettered = np.flatnonzero((below == pictures.CHALK).all(axis=2).any(axis=0))
    # first and last number stand below the ends of the bar
    assert lettered.min() == pytest.approx(10, abs=2)
    assert lettered.max() > 10 + pictures.COLOUR_BAR[0]


@pytest.mark.parametrize(("longest", "length"), [(9.9, 5.0), (10.0, 10.0), (0.3, 0.2), (1.0, 1.0)])
def test_a_scale_bar_has_a_round_length(longest, length):
    assert pictures.scale_length(longest) == pytest.approx(length)
