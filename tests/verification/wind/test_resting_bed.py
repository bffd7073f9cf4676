"""Where grains land on a bed, against geometry."""

from math import log, pi, sqrt

import numpy as np
import pytest

from taichi_erosion.core.snapshot import Snapshot
from tests.verification.reference.hopping import KARMAN, Sand, hopping_threshold, wind
from tests.verification.wind.saltation import DROPS, landing_heights, roughness

DIAMETER = 2.5e-4  # m


def bed(*places: tuple[float, float, float]) -> Snapshot:
    """Grains of one size at given places, in diameters."""
    count = len(places)
    return Snapshot(
        time=0.0,
        step=0,
        position=DIAMETER * np.array(places),
        velocity=np.zeros((count, 3)),
        spin=np.zeros((count, 3)),
        radius=np.full(count, 0.5 * DIAMETER),
        mass=np.ones(count),
        contacts=np.zeros(count, np.int32),
        ident=np.arange(count, dtype=np.int32),
        waiting=0,
    )


def test_a_grain_lands_on_another_as_on_a_cap_of_twice_its_radius():
    # over a patch of A, a cap of radius d covers pi d^2 and is 2/3 d high in the mean; else the floor carries
    side = 3.0
    share = pi / side**2
    want = share * (0.5 + 2.0 / 3.0) + (1.0 - share) * 0.5
    heights = landing_heights(bed((0.1, 2.9, 0.5)), DIAMETER * np.array([side, side]), DIAMETER)
    # sd of one place is 0.34 d; four standard errors of the mean
    assert heights.mean() / DIAMETER == pytest.approx(want, abs=4.0 * 0.34 / sqrt(DROPS))
    assert heights.max() / DIAMETER == pytest.approx(1.5, abs=0.01)


def test_a_grain_lands_on_the_higher_of_two():
    heights = landing_heights(
        bed((0.5, 0.5, 0.5), (0.5, 0.5, 4.0)), DIAMETER * np.array([1.0, 1.0]), DIAMETER
    )
    # every place of so small a patch is within 0.71 d of the upper grain
    assert heights.min() / DIAMETER > 4.0 + sqrt(1.0 - 0.5) - 1e-9


def test_a_wind_that_a_bed_slows_down_must_be_stronger_to_keep_a_grain_going():
    sand = Sand(DIAMETER)

    def slowed(friction: float):
        blow = wind(friction, sand.viscosity)
        return lambda z: 0.8 * blow(z)

    alone = hopping_threshold(sand)
    # u goes with u* and somewhat more near the bed, where the viscous layer becomes thinner
    assert 1.05 < hopping_threshold(sand, slowed) / alone < 1.25


def test_the_roughness_of_a_log_law_is_found_again():
    z0, friction = 1e-5, 0.3
    assert roughness(lambda z: friction / KARMAN * log(z / z0), friction, 0.02) == pytest.approx(z0, rel=1e-9)
