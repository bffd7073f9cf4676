"""The grain that hops is itself held against limits that are known."""

from math import hypot, inf, log

import pytest

from tests.verification.reference.hopping import (
    KARMAN,
    Sand,
    bounce,
    hop,
    hopping_threshold,
    time_to_rest,
    wind,
)

NU = 1.46e-5  # m2 s-1


def test_the_wind_is_laminar_at_the_bed_and_logarithmic_far_above():
    blow = wind(0.3, NU)
    # at a tenth of nu / u* eddies carry next to nothing; rows of the profile are 0.3 % apart
    assert blow(0.1 * NU / 0.3) == pytest.approx(0.1 * 0.3, rel=1e-2)
    assert blow(0.2) - blow(0.02) == pytest.approx(0.3 / KARMAN * log(10.0), rel=1e-2)


def test_without_air_a_hop_ends_as_it_began():
    # up and down again takes 2 v / g; an event found by a method of relative tolerance 1e-4
    assert hop(Sand(2.5e-4, air=1e-9), wind(0.3, NU), 0.5, 0.3) == pytest.approx(
        (2.0 * 0.3 / 9.81, 0.5, 0.3), rel=1e-3
    )


def test_a_grain_bounces_as_measured():
    # at 30 degrees: 0.87 - 0.72 / 2 of the speed, and 0.87 / sqrt(1/2) - 0.72 of the vertical one
    ahead, up = bounce(3.0**0.5, 1.0)
    assert hypot(ahead, up) == pytest.approx(2.0 * 0.51)
    assert up == pytest.approx(0.87 * 2.0**0.5 - 0.72)


def test_the_threshold_of_coarse_grains_goes_with_the_root_of_their_diameter():
    # 24 / Re and the viscous layer of the wind still take some percent
    fine, coarse = (hopping_threshold(Sand(size)) / Sand(size).scale for size in (5e-4, 1e-3))
    assert coarse == pytest.approx(fine, rel=0.05)
    assert 0.05 < fine < 0.1  # Bagnold (1941) measured 0.08


def test_a_grain_hops_on_for_many_hops_in_a_wind_that_is_a_little_too_weak():
    sand = Sand(2.5e-4)
    threshold = hopping_threshold(sand)
    much, little = (time_to_rest(sand, 2.0 * threshold, share * threshold) for share in (0.8, 0.95))
    # landings are some 0.07 s apart; the loss between them vanishes at the threshold
    assert 0.5 < much < little < inf
    assert little > 1.5 * much
    assert time_to_rest(sand, 2.0 * threshold, 1.05 * threshold) == inf
