"""References and readings of claims that no simulation checks, against limits and laws that were given."""

from math import hypot, log, pi, sqrt

import numpy as np
import pandas as pd
import pytest

from tests.measures.heaps import snapshot_of
from tests.verification.reference import flow as bulk
from tests.verification.reference.hopping import KARMAN, Sand, bounce, hop, hopping_threshold, scale, wind
from tests.verification.wind.saltation import AIR, DROPS, STEADY, landing_heights, roughness, vanishing

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
    # an event found by a method of relative tolerance 1e-4
    assert hop(Sand(2.5e-4, air_density=1e-9), wind(0.3, NU), 0.5, 0.3) == pytest.approx((0.5, 0.3), rel=1e-3)


def test_a_grain_bounces_as_measured():
    # at 30 degrees: 0.87 - 0.72 / 2 of the speed, and 0.87 / sqrt(1/2) - 0.72 of the vertical one
    ahead, up = bounce(3.0**0.5, 1.0)
    assert hypot(ahead, up) == pytest.approx(2.0 * 0.51)
    assert up == pytest.approx(0.87 * 2.0**0.5 - 0.72)


def test_the_threshold_of_coarse_grains_goes_with_the_root_of_their_diameter():
    # 24 / Re and the viscous layer of the wind still take some percent
    fine, coarse = (hopping_threshold(sand) / scale(sand) for sand in map(Sand, (5e-4, 1e-3)))
    assert coarse == pytest.approx(fine, rel=0.05)
    assert 0.05 < fine < 0.1  # Bagnold (1941) measured 0.08


DIAMETER, THRESHOLD = 2.5e-4, 0.17  # m, m s-1


def test_a_grain_lands_on_another_as_on_a_cap_of_twice_its_radius():
    # over a patch of A, a cap of radius d covers pi d^2 and is 2/3 d high in the mean; else the floor carries
    side = 3.0
    want = 0.5 + pi / side**2 * 2.0 / 3.0
    bed = snapshot_of(DIAMETER * np.array([[0.1, 2.9, 0.5]]), DIAMETER)
    heights = landing_heights(bed, DIAMETER * np.array([side, side]), DIAMETER)
    # sd of one place is 0.34 d; four standard errors of the mean
    assert heights.mean() / DIAMETER == pytest.approx(want, abs=4.0 * 0.34 / sqrt(DROPS))
    assert heights.max() / DIAMETER == pytest.approx(1.5, abs=0.01)


def test_the_roughness_of_a_log_law_is_found_again():
    z0, friction = 1e-5, 0.3
    assert roughness(lambda z: friction / KARMAN * log(z / z0), friction, 0.02) == pytest.approx(z0, rel=1e-9)


def test_momentum_that_the_air_above_gives_back_does_not_move_the_threshold():
    # the stress that arrives at the bed counts, not that of the lid: 0.03 Pa come down from above
    kept = AIR * THRESHOLD**2
    winds = pd.DataFrame({"grain_stress": [AIR * patch.wind**2 - kept + 0.03 for patch in STEADY]})
    assert vanishing(winds.assign(bed_stress=kept)).middle == pytest.approx(THRESHOLD, rel=1e-6)
