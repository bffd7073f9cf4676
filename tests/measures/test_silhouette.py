"""Drawing spheres, cleaning a picture, reading its upper edge, and the straight line through a flank."""

from math import cos, degrees, pi, radians, sin, tan

import numpy as np
import pytest
from scipy.signal import lfilter

from taichi_erosion.measures import silhouette

COLUMNS = 400
GRAIN = 8.0  # px


def test_discs_are_drawn_as_a_pixel_by_pixel_search_finds_them():
    rng = np.random.default_rng(3)
    rows, columns = 40, 60
    discs = np.stack([rng.uniform(-5, 65, 50), rng.uniform(-5, 45, 50), rng.uniform(1, 6, 50)])
    drawn = silhouette.fill_discs(discs, (rows, columns))
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
        picture = silhouette.draw_silhouette(position, radius, azimuth, 0.0, diameter)
        middle = picture.left + (np.flatnonzero(picture.image.any(axis=0)).mean() + 0.5) * picture.pixel
        assert middle == pytest.approx(3e-3 * cos(azimuth) - 4e-3 * sin(azimuth), abs=picture.pixel)
        # outward rounding adds up to one pixel above and below each of the eight columns
        assert pi / 4 <= picture.image.sum() / 8**2 <= pi / 4 + 2 / 8


def test_one_distant_runaway_does_not_coarsen_the_picture():
    heap = np.vstack([np.random.default_rng(4).uniform(-0.01, 0.01, (500, 3)), [[50.0, 0.0, 1e-3]]])
    picture = silhouette.draw_silhouette(heap, np.full(501, 1e-3), 0.0, 0.0, 2e-3)
    assert picture.pixel == pytest.approx(2e-3 / 8)
    assert picture.image.shape[1] * picture.pixel < 0.06


def test_detached_specks_vanish_and_holes_close():
    image = np.zeros((20, 30), dtype=bool)
    image[8:20, 5:20] = True
    image[12:15, 9:12] = False
    image[2:4, 24:26] = True
    body = silhouette.largest_connected_body(image)
    assert body[12:15, 9:12].all()
    assert not body[2:4, 24:26].any()


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_the_errors_hold_where_neighbouring_columns_show_the_same_grain(correlation):
    x = np.arange(COLUMNS) + 0.5
    # stationary first-order autoregressive noise of unit variance
    gain, shocks = (1.0 - correlation**2) ** 0.5, np.random.default_rng(10).normal(size=(300, COLUMNS + 200))
    noises = lfilter([gain], [1.0, -correlation], shocks)[:, 200:]
    flanks = [silhouette.fit_flank(x, 200.0 - 0.4 * x + noise) for noise in noises]
    for fitted, claimed in (("angle", "error"), ("bend", "bend_error")):
        seen = np.std([getattr(flank, fitted) for flank in flanks])
        stated = np.mean([getattr(flank, claimed) for flank in flanks])
        # 300 series know their sd to 4 %; short series underestimate a high correlation
        assert stated == pytest.approx(seen, rel=0.25)


def roof(angle=30.0, half_width=200):
    """Outline of an ideal heap, one pixel per column, with bare ground on both sides."""
    position = np.arange(-300, 300) + 0.5
    return position, np.clip((half_width - np.abs(position)) * tan(radians(angle)), 0.0, None)


def right_flank(position, height):
    return silhouette.fit_flanks(silhouette.Outline(position, height, 1.0), GRAIN, 3 * GRAIN)[1]


def test_the_line_of_an_ideal_roof_is_exact_and_ends_at_a_gap_wider_than_a_grain():
    left, right = silhouette.fit_flanks(silhouette.Outline(*roof(), 1.0), GRAIN, 3 * GRAIN)
    for flank in (left, right):
        assert flank.angle == pytest.approx(30.0, abs=1e-9)
        assert flank.apex == pytest.approx(200.0 * tan(radians(30.0)))
        assert flank.residual == pytest.approx(0.0, abs=1e-9)
        # 0.75 and 0.15 of the height lie at 0.25 and 0.85 of the half width
        assert (flank.start, flank.end) == pytest.approx((50.0, 170.0), abs=1.0)
    # a gap narrower than a grain does not end the flank
    position, height = roof()
    narrow, wide = height.copy(), height.copy()
    narrow[(position > 100) & (position < 105)] = 0.0
    wide[(position > 100) & (position < 115)] = 0.0
    assert right_flank(position, narrow).end > 160.0
    assert right_flank(position, wide).end < 101.0


def test_columns_chosen_by_the_line_do_not_flatten_it():
    rng = np.random.default_rng(11)
    position, height = roof()
    noisy = [height + (height > 0) * rng.normal(0.0, 5.0, 600) for _ in range(100)]
    # white noise of 5 px over 120 columns moves a slope by 5 sqrt(12 / 120^3), its angle by cos^2 = 3/4 of it
    error = degrees(5.0 * (12.0 / 120.0**3) ** 0.5) * 0.75 / 100**0.5
    assert np.mean([right_flank(position, top).angle for top in noisy]) == pytest.approx(30.0, abs=4 * error)
