"""How the threshold of saturated transport is read off winds well above it, and how scenes scale."""

from math import isnan, nan

import pytest

from taichi_erosion.scene.preparation.sizes import nominal_diameter
from taichi_erosion.verification.wind.saltation import AIR, STEADY, ends, scaled, steady, stresses, vanishing

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


def test_winds_and_times_go_with_the_root_of_the_diameter():
    stage = {"name": "blow", "duration_max": 2.0, "friction_velocity": 0.3}
    assert scaled(stage, 4.0) == {"name": "blow", "duration_max": 4.0, "friction_velocity": 0.6}


def test_a_patch_counts_in_diameters():
    small, large = (steady(size, STEADY[0]) for size in (1.0, 2.0))
    assert small.wind is not None
    assert large.wind is not None
    assert large.wind.length == pytest.approx(2.0 * small.wind.length)
    assert nominal_diameter(large.grains.size) == pytest.approx(2.0 * nominal_diameter(small.grains.size))
    assert large.grains.count == small.grains.count
    # k / (m g / d) is the same: the modulus goes with the diameter
    softer, stiffer = (scene.materials["sand"].shear_modulus for scene in (small, large))
    assert softer is not None
    assert stiffer == pytest.approx(2.0 * softer)
