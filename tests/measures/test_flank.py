"""The straight line through a flank, its honest error, and what belongs to the flank."""

from math import atan, degrees, radians, tan

import numpy as np
import pytest
from scipy.signal import lfilter

from taichi_erosion.measures.flank import Outline, fit_flank, fit_flanks, fit_polynomial, is_bent

COLUMNS = 400
GRAIN = 8.0  # px


def grainy(correlation, rng):
    """Stationary first-order autoregressive noise of unit variance."""
    shocks = rng.normal(size=COLUMNS + 200) * (1.0 - correlation**2) ** 0.5
    return lfilter([1.0], [1.0, -correlation], shocks)[200:]


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_the_errors_hold_where_neighbouring_columns_show_the_same_grain(correlation):
    rng = np.random.default_rng(10)
    distance = np.arange(COLUMNS) + 0.5
    flanks = [fit_flank(distance, 200.0 - 0.4 * distance + grainy(correlation, rng)) for _ in range(300)]
    for fitted, claimed in (("angle", "error"), ("bend", "bend_error")):
        seen = np.std([getattr(flank, fitted) for flank in flanks])
        stated = np.mean([getattr(flank, claimed) for flank in flanks])
        # 300 series know their sd to 4 %; short series underestimate a high correlation
        assert stated == pytest.approx(seen, rel=0.25)


def test_a_point_of_weight_two_counts_as_two_points():
    t, height = np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 2.0, 1.0, 5.0])
    weighted = fit_polynomial(t, height, 1, weight=np.array([1.0, 1.0, 2.0, 1.0]))
    doubled = np.polyfit(np.append(t, 2.0), np.append(height, 1.0), 1)[::-1]
    np.testing.assert_allclose(weighted.coefficients, doubled)


def roof(angle=30.0, half_width=200):
    """Outline of an ideal heap, one pixel per column, with bare ground on both sides."""
    position = np.arange(-300, 300) + 0.5
    return position, np.clip((half_width - np.abs(position)) * tan(radians(angle)), 0.0, None)


def right_flank(position, height):
    return fit_flanks(Outline(position, height, 1.0), GRAIN, 3 * GRAIN)[1]


def test_the_line_of_an_ideal_roof_is_exact():
    left, right = fit_flanks(Outline(*roof(), 1.0), GRAIN, 3 * GRAIN)
    for flank in (left, right):
        assert flank.angle == pytest.approx(30.0, abs=1e-9)
        assert flank.apex == pytest.approx(200.0 * tan(radians(30.0)))
        assert flank.residual == pytest.approx(0.0, abs=1e-9)
        # 0.75 and 0.15 of the height lie at 0.25 and 0.85 of the half width
        assert (flank.start, flank.end) == pytest.approx((50.0, 170.0), abs=1.0)


def test_a_gap_narrower_than_a_grain_does_not_end_the_flank():
    position, height = roof()
    narrow, wide = height.copy(), height.copy()
    narrow[(position > 100) & (position < 105)] = 0.0
    wide[(position > 100) & (position < 115)] = 0.0
    assert right_flank(position, narrow).end > 160.0
    assert right_flank(position, wide).end < 101.0


def test_what_lies_beyond_the_foot_is_not_flank():
    position, height = roof()
    beside = height.copy()
    beside[(position > 230) & (position < 290)] = 60.0
    assert right_flank(position, beside) == right_flank(position, height)


def test_columns_chosen_by_the_line_do_not_flatten_it():
    rng = np.random.default_rng(11)
    position, height = roof()
    noisy = [height + (height > 0) * rng.normal(0.0, 5.0, 600) for _ in range(100)]
    # white noise of 5 px over 120 columns moves a slope by 5 sqrt(12 / 120^3), its angle by cos^2 = 3/4 of it
    error = degrees(5.0 * (12.0 / 120.0**3) ** 0.5) * 0.75 / 100**0.5
    assert np.mean([right_flank(position, top).angle for top in noisy]) == pytest.approx(30.0, abs=4 * error)
    naive = []
    for top in noisy:
        chosen = (position > 0) & (top > 0.15 * top.max()) & (top < 0.75 * top.max())
        naive.append(degrees(atan(-np.polyfit(position[chosen], top[chosen], 1)[0])))
    assert np.mean(naive) < 30.0 - 20 * error


def test_a_bend_must_be_certain_and_large():
    assert is_bent(-8.0, 1.0)
    assert not is_bent(8.0, 4.0)
    assert not is_bent(3.0, 0.1)
    assert not is_bent(30.0, float("nan"))
