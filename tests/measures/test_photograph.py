"""Photographs drawn here, of heaps whose angle and base line are known."""

from math import atan, cos, degrees, radians, sin, tan

import imageio.v3 as imageio
import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from taichi_erosion.core.errors import BadInput
from taichi_erosion.measures.heap import repose_angle
from taichi_erosion.measures.photograph import measure_photograph
from taichi_erosion.measures.silhouette import draw_silhouette
from taichi_erosion.report.pictures import WIDTH, draw_detection
from tests.measures.heaps import DIAMETER, cone, snapshot_of

ROWS, COLUMNS, BASE, HALF_WIDTH = 420, 640, 360, 240  # px; the row of the base line
GREY = (0.85, 0.2)  # background, heap
TILTED = [(34.0, -8.0, "whole"), (18.0, 4.0, "whole"), (34.0, 1.0, "strip"), (34.0, -6.0, "none")]


def standing(left, right=None, plate="strip", tilt=0.0, half=HALF_WIDTH, base=BASE):
    """Whether a heap with these flank angles [deg] stands at each pixel, and whether its plate does.

    The plate is a strip of 20 px, reaches down to the frame (whole), or is not seen (none).
    """
    row, column = np.mgrid[0:ROWS, 0:COLUMNS] + 0.5
    c, s = cos(radians(tilt)), sin(radians(tilt))
    across = (column - COLUMNS / 2) * c + (row - base) * s
    up = (column - COLUMNS / 2) * s - (row - base) * c
    slopes = tan(radians(left)), tan(radians(right or left))
    heap = (up > 0.0) & (up < half * min(slopes) - np.where(across < 0.0, *slopes) * np.abs(across))
    return heap, (up <= 0.0) & (up > {"strip": -20.0, "whole": -np.inf, "none": 0.0}[plate]), across, up


def covered(*flanks, **options):
    """Where a heap and its plate hide the background."""
    heap, plate, *_ = standing(*flanks, **options)
    return heap | plate


def save(path, grey):
    """Write an 8-bit picture of shades of grey from 0 to 1."""
    imageio.imwrite(path, (np.clip(grey, 0.0, 1.0) * 255).astype(np.uint8))
    return path


def photograph(path, *flanks, grey=GREY, **options):
    """Write an 8-bit picture of a heap on a strip of plate."""
    return save(path, np.where(covered(*flanks, **options), grey[1], grey[0]))


def pixel_error(angle, pixels=1.0):
    """What an edge misplaced by this many pixels at one end of the flank does to the angle [deg]."""
    return degrees(pixels / (0.6 * HALF_WIDTH)) * cos(radians(angle)) ** 2


@pytest.mark.parametrize("angle", [18.0, 25.0, 33.52, 41.0])
@pytest.mark.parametrize("grey", [(0.85, 0.2), (0.1, 0.7)], ids=["dark on light", "light on dark"])
@pytest.mark.parametrize("plate", ["strip", "none"])
def test_a_drawn_heap_shows_its_angle(tmp_path, angle, grey, plate):
    record = measure_photograph(photograph(tmp_path / "heap.png", angle, grey=grey, plate=plate))
    assert record["value"] == pytest.approx(angle, abs=pixel_error(angle))
    assert record["details"]["flags"] == []
    assert (record["unit"], record["n"]) == ("deg", 1)


def test_dust_and_glints_leave_the_angle(tmp_path):
    picture = np.where(covered(32.0), 40, 220)
    specks = np.random.default_rng(12).uniform(size=picture.shape)
    picture = np.where(specks < 0.12, 0, np.where(specks > 0.88, 255, picture)).astype(np.uint8)
    imageio.imwrite(tmp_path / "dust.png", picture)
    record = measure_photograph(tmp_path / "dust.png")
    assert record["value"] == pytest.approx(32.0, abs=pixel_error(32.0, 2.0))
    assert record["details"]["residual_pixels"] < 2.0


HEAP = covered(30.0)
CODED = {
    "colour": np.where(HEAP[..., np.newaxis], [120, 80, 40], [150, 200, 250]).astype(np.uint8),
    "sixteen bits": np.where(HEAP, 9000, 52000).astype(np.uint16),
}


@pytest.mark.parametrize("kind", CODED)
def test_colour_and_sixteen_bits_are_read(tmp_path, kind):
    imageio.imwrite(tmp_path / "heap.png", CODED[kind])
    assert measure_photograph(tmp_path / "heap.png")["value"] == pytest.approx(30.0, abs=pixel_error(30.0))


def test_a_telephone_held_sideways_is_turned_upright_and_the_difference_of_its_flanks_is_their_sd(tmp_path):
    upright = (np.where(covered(35.0, 27.0), 0.2, 0.9) * 255).astype(np.uint8)
    exif = Image.Exif()
    exif[0x0112] = 6  # orientation: turn by 90 deg clockwise to see it upright
    Image.fromarray(np.rot90(upright)).save(tmp_path / "sideways.jpg", exif=exif)
    record = measure_photograph(tmp_path / "sideways.jpg")
    assert record["details"]["left"] == pytest.approx(35.0, abs=pixel_error(35.0, 2.0))
    assert record["details"]["right"] == pytest.approx(27.0, abs=pixel_error(27.0, 2.0))
    assert record["sd"] == pytest.approx(4.0, abs=pixel_error(31.0, 2.0))


def taken(path, angle=34.0, tilt=0.0, noise=0.0, light=0.0, shadow=0.0, seen="whole"):
    """Photograph by a tilted camera, in light that falls off to the right, with a shadow."""
    heap, plate, across, up = standing(angle, plate=seen, tilt=tilt, half=200.0, base=BASE - 30)
    grey = np.where(heap | plate, 0.25, 0.8)
    cast = (across > 0.0) & (up > 0.0) & ~heap
    cast &= up < 200.0 * tan(radians(angle)) - tan(radians(12.0)) * across
    fading = light * (0.5 - np.arange(0.5, COLUMNS) / COLUMNS)
    grey = gaussian_filter(np.where(cast, grey - shadow, grey) + fading, 0.8)
    grey = grey + np.random.default_rng(4).normal(0.0, noise, grey.shape) if noise else grey
    return save(path, grey)


@pytest.mark.parametrize(("angle", "tilt", "plate"), TILTED)
@pytest.mark.parametrize(("noise", "light"), [(0.0, 0.0), (0.08, 0.4)])
def test_a_tilted_photograph_is_turned_and_says_so(tmp_path, angle, tilt, plate, noise, light):
    record = measure_photograph(taken(tmp_path / "heap.png", angle, tilt, noise, light, seen=plate))
    # a pixel at one end of the flanks, and of the base line across the picture
    assert record["value"] == pytest.approx(angle, abs=pixel_error(angle, 1.5))
    assert record["details"]["tilt"] == pytest.approx(tilt, abs=0.3)
    assert f"the base line falls by {abs(record['details']['tilt']):.1f} deg" in record["notes"][0]
    assert record["sd"] < 0.5


@pytest.mark.parametrize(
    ("condition", "reason"),
    [
        ({"angle": 4.0}, "no heap|flatter than any heap"),
        ({"shadow": 0.45}, "34 and 12 deg"),
        ({"tilt": 28.0}, "not certain"),
    ],
)
def test_an_uncertain_detection_is_refused_with_the_reason(tmp_path, condition, reason):
    with pytest.raises(BadInput, match=reason):
        measure_photograph(taken(tmp_path / "picture.png", **condition))


def test_what_was_detected_is_drawn_over_the_photograph(tmp_path):
    path = taken(tmp_path / "heap.png", 34.0, tilt=4.0)
    record = measure_photograph(path)
    drawn = record["details"]["drawing"]
    (x0, y0), (x1, y1) = drawn["base"]
    assert degrees(atan((y1 - y0) / (x1 - x0))) == pytest.approx(4.0, abs=0.2)
    (x0, y0), (x1, y1) = drawn["left"]
    assert degrees(atan((y1 - y0) / (x1 - x0))) == pytest.approx(4.0 - 34.0, abs=0.5)
    picture = imageio.imread(draw_detection(path, record, tmp_path / "heap.detected.png"))
    assert picture.shape[1] == WIDTH
    assert np.ptp(picture[..., :3].astype(int), axis=2).max() > 150, "lines in colour over a grey photograph"


def test_a_crop_keeps_a_label_beside_the_heap_out(tmp_path):
    picture = np.where(covered(28.0), 0.2, 0.85)
    picture[:, 600:] = 0.1
    picture[:200, 20:60] = 0.1
    record = measure_photograph(save(tmp_path / "label.png", picture), crop=(62, 100, 578, 375))
    assert record["value"] == pytest.approx(28.0, abs=pixel_error(28.0))
    assert record["details"]["base_row"] == BASE
    assert record["details"]["axis_column"] == pytest.approx(COLUMNS / 2, abs=1.0)


def test_a_truncated_cone_and_a_cut_heap_are_flagged(tmp_path):
    picture = np.where(covered(35.0), 40, 220).astype(np.uint8)
    picture[: BASE - 80] = 220
    imageio.imwrite(tmp_path / "flat.png", picture)
    assert measure_photograph(tmp_path / "flat.png")["details"]["flags"] == ["flat_top"]
    cut = measure_photograph(photograph(tmp_path / "heap.png", 35.0), crop=(150, 100, 640, 380))
    assert cut["details"]["flags"] == ["cut_by_frame"]
    assert "edge of the picture" in cut["notes"][0]


def test_a_picture_of_a_simulated_heap_measures_as_the_heap_itself(tmp_path):
    centres = cone(31.0)
    picture = draw_silhouette(centres, np.full(len(centres), 0.5 * DIAMETER), 0.0, 0.0, DIAMETER)
    framed = np.pad(picture.image, ((10, 0), (0, 0)))
    imageio.imwrite(tmp_path / "silhouette.png", np.where(framed, 0, 255).astype(np.uint8))
    photographed = measure_photograph(tmp_path / "silhouette.png")["value"]
    measured = repose_angle(snapshot_of(centres), azimuths=1).value
    # the base is found 3 % of the height too high, which moves the ends of the fit by less than a grain
    assert photographed == pytest.approx(measured, abs=0.5)


def half_dark(rows, columns):
    picture = np.full((200, 300), 220, dtype=np.uint8)
    picture[rows, columns] = 30
    return picture


GREY = gaussian_filter(np.random.default_rng(13).normal(size=(200, 300)), 12.0)
NO_HEAPS = {
    "blank": (np.full((200, 300), 128, dtype=np.uint8), "nothing stands out"),
    "snow": (np.random.default_rng(9).integers(0, 256, (200, 300), dtype=np.uint8), "no heap"),
    "clouds": ((255 * (GREY - GREY.min()) / np.ptp(GREY)).astype(np.uint8), "nothing stands out"),
    "plate": (half_dark(slice(150, None), slice(None)), "no heap"),
    "wall": (half_dark(slice(None), slice(150)), "no heap"),
}


@pytest.mark.parametrize("name", NO_HEAPS)
def test_what_shows_no_heap_is_bad_input_in_one_line(tmp_path, name):
    picture, reason = NO_HEAPS[name]
    imageio.imwrite(tmp_path / f"{name}.png", picture)
    with pytest.raises(BadInput, match=rf"{name}\.png: .*{reason}") as refusal:
        measure_photograph(tmp_path / f"{name}.png")
    assert "\n" not in str(refusal.value)
