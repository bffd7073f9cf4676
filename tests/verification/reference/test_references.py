"""References of the claims against tables, limits and laws that they were given."""

from math import hypot, inf, log, radians

import numpy as np
import pytest

from tests.verification.contact.oblique_impact import OXIDE, impact_at
from tests.verification.reference import contact, motion, published
from tests.verification.reference import flow as bulk
from tests.verification.reference.contact import HeadOn, Solid, rebound, sphere_mass, young_effective
from tests.verification.reference.hopping import (
    KARMAN,
    Sand,
    bounce,
    hop,
    hopping_threshold,
    time_to_rest,
    wind,
)

HERTZ = [
    # solid, radius, two spheres, relative speed; E*, overlap, force, time of the verification notes 1.1
    (Solid(4.8e10, 0.20, 2800.0), 0.010, True, 20.0, 2.5e10, 274.1127e-6, 10696.889, 40.339e-6),
    (Solid(2.0e10, 0.25, 2500.0), 0.010, True, 20.0, 1.06667e10, 368.3040e-6, 7108.241, 54.201e-6),
    (Solid(7.0e10, 0.30, 2699.0), 0.100, False, 0.2, 7.69231e10, 49.71718e-6, 11369.858, 731.66e-6),
    (Solid(4.0e10, 0.35, 1800.0), 0.100, False, 0.2, 4.55840e10, 52.12329e-6, 7232.681, 767.07e-6),
    (Solid(3.8e11, 0.23, 4000.0), 0.0025, False, 3.9, 4.01225e11, 8.088808e-6, 615.3516, 6.1046e-6),
    (Solid(1.0e11, 0.25, 7000.0), 0.0025, False, 3.9, 1.06667e11, 17.18871e-6, 506.7602, 12.972e-6),
]


@pytest.mark.parametrize("row", HERTZ)
def test_hertz_impacts_reach_the_tabulated_peaks(row) -> None:
    solid, radius, paired, speed, young, overlap, force, time = row
    share = 0.5 if paired else 1.0
    stiffness = young_effective(solid, solid if paired else None)
    impact = HeadOn(stiffness, share * radius, share * sphere_mass(radius, solid.density), speed)
    # the table is rounded to its last digit
    assert impact.young == pytest.approx(young, rel=1e-5)
    assert impact.overlap_peak == pytest.approx(overlap, rel=1e-6)
    assert impact.force_peak == pytest.approx(force, rel=1e-6)
    assert impact.duration == pytest.approx(time, rel=2e-5)


def test_both_caps_of_friction_agree_where_a_nearly_elastic_contact_slides_throughout() -> None:
    steep = published.OBLIQUE_ANGLE[published.OBLIQUE_ANGLE > 33.0]
    elastic, whole = (rebound(impact_at(OXIDE, steep, cap), 4000).tangential for cap in ("elastic", "whole"))
    assert whole == pytest.approx(elastic, rel=2e-4)


def test_jkr_landmarks_follow_from_the_two_polynomials() -> None:
    assert contact.force_at(contact.CUBE_PULL_OFF) == pytest.approx(-3.0)
    assert contact.force_at(contact.CUBE_TOUCH) == pytest.approx(-8.0 / 3.0)
    assert contact.overlap_at(contact.CUBE_PULL_OFF) == pytest.approx(-0.57236, abs=1e-5)
    assert contact.overlap_at(contact.CUBE_TEAR) == pytest.approx(-1.190551, abs=1e-6)
    assert contact.overlap_at(contact.CUBE_BALANCE) == pytest.approx(1.44225, abs=1e-5)


def test_the_work_of_the_neck_is_the_area_under_the_force() -> None:
    cube = np.linspace(contact.CUBE_TEAR, contact.CUBE_TOUCH, 20_001)
    force = 4.0 / 3.0 * cube * (cube - 3.0)
    overlap = cube ** (4.0 / 3.0) - 2.0 * cube ** (1.0 / 3.0)
    assert -np.trapezoid(force, overlap) == pytest.approx(contact.WORK_LOST, rel=1e-7)


OPENINGS, GRAIN = 0.002 * np.repeat([6.0, 8.0, 11.0, 15.0], 4), 0.002
SCATTER = 0.05  # of a flow from filling to filling


def flows(exponent: float, seed: int = 0, scatter: float = SCATTER) -> np.ndarray:
    noise = np.exp(scatter * np.random.default_rng(seed).standard_normal(OPENINGS.size))
    return 7.0 * (OPENINGS - 1.5 * GRAIN) ** exponent * noise


@pytest.mark.parametrize("exponent", [1.5, 2.5])
def test_beverloo_fits_return_the_law_they_were_given(exponent: float) -> None:
    exact = flows(exponent, scatter=1e-9)
    assert bulk.discharge_exponent(OPENINGS, GRAIN, exact, 1.5)[0] == pytest.approx(exponent, rel=1e-6)
    assert bulk.discharge_edge(OPENINGS, GRAIN, exact, exponent)[0] == pytest.approx(1.5, rel=1e-5)


def test_errors_of_beverloo_fits_are_those_of_repeated_fillings() -> None:
    series = [flows(2.5, seed) for seed in range(300)]
    slopes = np.array([bulk.discharge_exponent(OPENINGS, GRAIN, flow, 1.5) for flow in series])
    edges = np.array([bulk.discharge_edge(OPENINGS, GRAIN, flow, 2.5) for flow in series])
    for found in (slopes, edges):
        # the scatter of 300 series is known to 4 %, and so is the mean of their errors
        assert found[:, 1].mean() == pytest.approx(found[:, 0].std(ddof=1), rel=0.15)
    # one true law in twenty has a p below 0.05
    assert (edges[:, 2] < 0.05).mean() == pytest.approx(0.05, abs=0.04)


def test_the_lack_of_fit_refutes_another_exponent() -> None:
    chances = [bulk.discharge_edge(OPENINGS, GRAIN, flows(1.5, seed, 0.01), 2.5)[2] for seed in range(20)]
    assert np.median(chances) < 1e-3


def test_zhou_formula_gives_the_angle_of_the_known_example() -> None:
    # Lethe's plate discharge example: 10 mm, friction 0.2, rolling friction 0.1 diameters; 19.7 deg
    assert bulk.zhou_angle(0.2, 0.2, 1e-3, 1e-3, 0.010) == pytest.approx(19.7, abs=0.05)


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


def test_sliding_and_rolling_accelerations_meet_at_the_critical_friction() -> None:
    slope = radians(30.0)
    critical = motion.friction_for_rolling(slope)
    assert motion.sliding_acceleration(slope, critical) == pytest.approx(motion.rolling_acceleration(slope))
    assert motion.sliding_spin_up(slope, critical, 1.0) == pytest.approx(motion.rolling_acceleration(slope))


def test_a_weightless_damped_impact_returns_the_restitution_asked_for() -> None:
    spring = motion.Spring(young=1e8, radius=0.1, mass=10.0, restitution=0.5)
    assert motion.rebound_speed(spring, 2.0, 0.0) / 2.0 == pytest.approx(0.5, abs=2e-5)
