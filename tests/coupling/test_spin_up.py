"""A bed under wind: steady profiles, buoyancy, and the same bits alone, in company, resumed."""

from dataclasses import replace

import numpy as np
import pytest
from grain_worlds import fingerprint
from windy_beds import DENSITY, RADIUS, air, bed, set_in, weightless

from taichi_erosion import simulation
from taichi_erosion.core.device import stop_device
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Laws, Numerics

LAWS = Laws(rolling="elastic_plastic", drag="two_limits")
HALF, WHOLE = 0.006, 0.012  # s
WIND = 0.4  # m s-1, friction velocity


def blow(sim, replica: int) -> str:
    """Half without wind, half with; the bits of grains and air at the end."""
    set_in(sim, WIND, HALF, WHOLE)
    return bits(sim, replica)


def bits(sim, replica: int) -> str:
    wind = simulation.air_profile(sim, replica)
    return fingerprint(simulation.snapshot(sim, replica)) + wind.velocity.tobytes().hex()


@pytest.fixture(scope="module")
def alone():
    """One bed on one worker, with its state at half time, and what follows from that state again."""
    sim = simulation.assemble([bed(1)], LAWS, Numerics("cpu", 1))
    simulation.advance(sim, [HALF])
    simulation.spin_up_wind(sim, 0, WIND)
    rest, resting, developed = (
        simulation.export_bed(sim, 0),
        simulation.snapshot(sim, 0),
        simulation.air_profile(sim, 0),
    )
    state = simulation.export_state(sim)
    simulation.advance(sim, [WHOLE])
    end, moved = bits(sim, 0), simulation.snapshot(sim, 0)
    simulation.import_state(sim, state)
    simulation.advance(sim, [WHOLE])
    again = bits(sim, 0)
    simulation.import_bed(sim, 0, rest)
    put_back = simulation.snapshot(sim, 0)
    simulation.spin_up_wind(sim, 0, WIND, anew=True)
    residual_momentum = sim.coupling.exchange.residual_momentum.to_numpy()
    stop_device()
    return locals()


@pytest.fixture(scope="module")
def company():
    """The same bed between two others, on two workers; one of them does not move when its wind develops."""
    sim = simulation.assemble([bed(2), bed(1), bed(3, layers=2, speed=0.0)], LAWS, Numerics("cpu", 2))
    simulation.spin_up_wind(sim, 2, WIND)
    over_rest = simulation.air_profile(sim, 2)
    end = blow(sim, 1)
    stop_device()
    return locals()


def test_neighbours_and_an_earlier_state_change_no_bit(alone, company):
    assert company["end"] == alone["again"] == alone["end"]


def test_a_bed_put_back_lies_where_it_lay_and_owes_nothing(alone):
    back, resting = alone["put_back"], alone["resting"]
    assert np.array_equal(back.position, resting.position)
    assert np.array_equal(back.velocity[:, 2], resting.velocity[:, 2])
    assert not np.array_equal(back.position, alone["moved"].position)
    assert not alone["residual_momentum"].any()


def test_developed_air_hands_all_of_its_stress_to_grains_and_floor(alone):
    wind = alone["developed"]
    height = np.diff(wind.face)
    floor = DENSITY * 1.46e-5 * wind.void_fraction[0] * wind.velocity[0, 0] / (0.5 * height[0])
    taken = -(wind.drag[:, 0] * height).sum() + floor
    # Picard's rounds between drag and wind end when both agree to a few millionths
    assert taken == pytest.approx(DENSITY * WIND**2, rel=1e-4)


def test_developed_air_over_grains_at_rest_grows_with_height(company):
    wind = company["over_rest"].velocity[:, 0]
    # stress that comes in at the lid only: drag on grains at rest and the floor take from it
    assert np.all(wind > 0.0)
    assert np.all(np.diff(wind) > 0.0)


def test_deep_air_moves_with_its_grains_and_no_faster(alone):
    backwards, forwards = (pick(alone["resting"].velocity[:, 0]) for pick in (np.min, np.max))
    wind, bottom = alone["developed"].velocity[:, 0], alone["developed"].face[1:] < 2.0 * RADIUS
    assert backwards < 0.0 < forwards
    assert np.all(wind > backwards)
    assert np.all(wind[bottom] < forwards)


@pytest.mark.slow
def test_a_grain_of_the_density_of_the_air_floats():
    density = 1e-6 / (4.0 / 3.0 * np.pi * RADIUS**3)
    over = air(np.linspace(0.0, 0.02, 14), density=density)
    still = weightless([(4e-3, 4e-3, 0.01)], 0.0, over, look_steps=1)
    sim = simulation.assemble([replace(still, gravity=(0.3, 0.0, -9.81))], Laws(), Numerics("cpu", 1, "f64"))
    simulation.advance(sim, [0.01])
    state = simulation.snapshot(sim, 0)
    stop_device()
    assert np.abs(state.velocity).max() < 1e-12


def test_air_and_a_bed_without_air_cannot_share_an_ensemble():
    with pytest.raises(BadInput, match="with and without air"):
        simulation.assemble([bed(1), replace(bed(2), air=None)], LAWS, Numerics("cpu", 1))
