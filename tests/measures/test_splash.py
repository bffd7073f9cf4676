"""Landings, rebounds and ejecta of made-up hops."""

from math import atan2, degrees, hypot

import numpy as np
import pytest

from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures import splash, wind_bed
from tests.measures.heaps import snapshot_of

PATCH = wind_bed.Patch(area=2e-5, surface=1e-3, diameter=2.5e-4, density=1.2, viscosity=1.5e-5)
GRAVITY, EVERY, LENGTH = 9.81, 4e-3, 2.0  # m s-2; s between frames; s of the whole series
HOPS = ((0.4, 1.0), (0.3, 0.8))  # m s-1, upward and forward, of the first and of every later hop of a bouncer


def throws(start: float, hops: list[tuple[float, float]]) -> list[tuple[float, float, float]]:
    """Moments at which a grain leaves the height that is clear, with upward and forward speed there."""
    moments = []
    for up, ahead in hops:
        moments.append((start, up, ahead))
        start += 2.0 * up / GRAVITY + 2e-3  # below that height for two milliseconds
    return moments


def state(moments: list[tuple[float, float, float]], time: float) -> tuple[float, float, float]:
    """Height, forward and vertical speed of a grain at a time; in the bed before, between and after hops."""
    for start, up, ahead in moments:
        since = time - start
        if 0.0 < since < 2.0 * up / GRAVITY:
            return PATCH.clear + up * since - 0.5 * GRAVITY * since**2, ahead, up - GRAVITY * since
    return PATCH.surface, 0.0, 0.0


def frames(grains: list[list[tuple[float, float, float]]]) -> list[Snapshot]:
    series = []
    nought = np.zeros(len(grains))
    for time in np.arange(0.0, LENGTH, EVERY):
        height, ahead, up = np.transpose([state(moments, time) for moments in grains])
        place, velocity = np.stack([nought, nought, height], axis=1), np.stack([ahead, nought, up], axis=1)
        series.append(snapshot_of(place, PATCH.diameter, time, velocity=velocity))
    return series


def test_landings_of_known_hops_are_rebounds_or_catches_with_the_speeds_of_the_throws():
    twice = [throws(0.2 + 0.0371 * k, list(HOPS)) for k in range(12)]
    once = [throws(0.5 + 0.0123 * k, [(0.5, 0.6)]) for k in range(3)]
    landed = splash.count_splash_events(frames([*twice, *once, []]), PATCH, GRAVITY)
    # each of 12 grains lands twice and bounces once, each of 3 lands once; all 15 were thrown out of the bed
    assert len(landed.impacts) == 27
    assert splash.rebound_share(landed).value == pytest.approx(12 / 27)
    assert splash.ejecta_share(landed).value == pytest.approx(15 / 27)
    (up, ahead), (up_after, ahead_after) = HOPS
    speed = splash.rebound_speed_ratio(landed)
    # without drag a throw is exact, whatever the moment of the frame
    assert speed.value == pytest.approx(hypot(up_after, ahead_after) / hypot(up, ahead), rel=1e-9)
    assert speed.details["impact_speed"] == pytest.approx(hypot(up, ahead), rel=1e-9)
    assert speed.details["rebound_angle"] == pytest.approx(degrees(atan2(up_after, ahead_after)), rel=1e-9)


def test_what_the_ends_of_the_series_cut_off_is_not_counted():
    late = throws(LENGTH - 0.05, [(0.4, 1.0)])  # lands after the last frame
    early = throws(-0.01, [(0.4, 1.0)])  # left before the first one
    landed = splash.count_splash_events(frames([late, early]), PATCH, GRAVITY)
    assert (len(landed.impacts), landed.ejected) == (1, 1)


def test_slow_landings_do_not_rule_the_speed_of_rebounds():
    before = np.array([[1.0, -0.2]] * 20 + [[0.05, -0.01]] * 20)
    after = np.array([[0.5, 0.2]] * 20 + [[0.5, 0.2]] * 20)  # ten times as fast as the slow ones came
    speed = splash.rebound_speed_ratio(splash.Splash(before, after, 0))
    assert speed.value == pytest.approx(hypot(0.5, 0.2) / hypot(1.0, 0.2))
    assert speed.sd == pytest.approx(0.0, abs=1e-12)
    assert splash.rebound_speed_ratio(splash.Splash(before[20:], after[20:], 0)).n == 0


def test_a_grain_that_nothing_weighs_flies_on():
    landed = splash.count_splash_events(frames([throws(0.1, [(0.4, 1.0)])]), PATCH, 0.0)
    assert (len(landed.impacts), landed.ejected) == (0, 0)
