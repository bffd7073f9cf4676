"""How thresholds of saturated transport and places of landing are read, against geometry and lines."""

from math import isnan, log, nan, pi, sqrt

import numpy as np
import pytest

from taichi_erosion.core.snapshot import Snapshot
from tests.verification.reference.hopping import KARMAN
from tests.verification.wind.saltation import (
    AIR,
    DROPS,
    STEADY,
    ends,
    landing_heights,
    roughness,
    stresses,
    vanishing,
)

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


def test_the_roughness_of_a_log_law_is_found_again():
    z0, friction = 1e-5, 0.3
    assert roughness(lambda z: friction / KARMAN * log(z / z0), friction, 0.02) == pytest.approx(z0, rel=1e-9)


THRESHOLD = 0.17  # m s-1


def saturated(kept: float, excess: float = 0.0) -> list[dict[str, float]]:
    """Winds whose air keeps a stress [Pa] at the bed; `excess` comes down from above for the moment [Pa]."""
    carried = [AIR * patch.wind**2 - kept + excess for patch in STEADY]
    return [{"bed_stress": kept, "grain_stress": stress, "flux": 0.1 * stress} for stress in carried]


@pytest.mark.parametrize("name", ["grain_stress", "flux"])
def test_what_grains_take_from_the_wind_vanishes_at_the_stress_they_leave_to_it(name: str):
    values = saturated(AIR * THRESHOLD**2)
    assert vanishing(values, name).middle == pytest.approx(THRESHOLD, rel=1e-6)


def test_momentum_that_the_air_above_gives_back_does_not_move_the_threshold():
    # the stress that arrives at the bed counts, not that of the lid
    values = saturated(AIR * THRESHOLD**2, excess=0.03)
    assert stresses(values)[0] == pytest.approx(AIR * STEADY[0].wind ** 2 + 0.03)
    assert vanishing(values, "grain_stress").middle == pytest.approx(THRESHOLD, rel=1e-6)


def test_air_that_keeps_more_in_weak_winds_has_the_higher_threshold():
    values = saturated(AIR * THRESHOLD**2)
    values[0] |= {
        "bed_stress": values[0]["bed_stress"] + 0.005,
        "grain_stress": values[0]["grain_stress"] - 0.005,
    }
    line = vanishing(values, "grain_stress")
    assert line.low > THRESHOLD
    assert line.low < line.middle < line.high


def test_transport_that_was_not_measured_has_no_threshold():
    nothing = [{"bed_stress": nan, "grain_stress": nan, "flux": nan} for _ in STEADY]
    assert isnan(vanishing(nothing, "grain_stress").middle)
    assert ends(vanishing([{} for _ in STEADY], "flux")) == "no wind"
