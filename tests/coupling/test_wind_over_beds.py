"""A bed under a column or a grid of air: steady winds, and the same bits alone, in company, resumed."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from grain_worlds import RADIUS, fingerprint
from windy_beds import DENSITY, LID, SURFACE, VISCOSITY, air, bed, set_in, weightless

from taichi_erosion import simulation
from taichi_erosion.air.readback import face_velocities
from taichi_erosion.core.air_setup import AirModel, AirSide, InitialTurbulence, stress_gradient
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.simulation import Simulation
from tests.verification.small_scenes import final_states

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
LAWS = Laws(rolling="elastic_plastic", drag="two_limits")
WIND = 0.4  # m s-1, friction velocity
TIMES = {"column": (0.006, 0.012), "grid": (0.001, 0.002)}  # s without wind, and with it
kinds = pytest.mark.parametrize("kind", ["column", pytest.param("grid", marks=pytest.mark.slow)])


def under(kind: str, seed: int, **words: Any) -> Setup:
    """The bed of `windy_beds` under its column of air, or under a grid that eddies may stir."""
    table = bed(seed, **words)
    if kind == "column" or table.air is None:
        return table
    over = replace(
        table.air,
        cells=(4, 4, table.air.cells[2]),
        sides=table.air.sides | {"z_high": AirSide("symmetry")},
        model=AirModel("smagorinsky", exchange=True),
        time_step=5.0 * table.time_step,
        ground=SURFACE,
        initial_turbulence=InitialTurbulence(1.0, 0.1, RADIUS / 15.0, seed),
    )
    return replace(table, air=over)


def bits(sim: Simulation, replica: int) -> str:
    wind = b"".join(part.tobytes() for part in face_velocities(sim.coupling.air, replica))
    return fingerprint(simulation.snapshot(sim, replica)) + wind.hex()


@cache
def alone(kind: str) -> SimpleNamespace:
    """One bed on one worker, with its state under wind, what follows from that again, and from it at rest."""
    sim = simulation.assemble([under(kind, 1)], LAWS, Numerics("cpu", 1))
    (half, whole), stages = TIMES[kind], SimpleNamespace()
    simulation.advance(sim, [half])
    stages.still = simulation.air_profile(sim, 0)
    simulation.spin_up_wind(sim, 0, WIND)
    rest, stages.resting = simulation.export_bed(sim, 0), simulation.snapshot(sim, 0)
    stages.developed, stages.flow = simulation.air_profile(sim, 0), face_velocities(sim.coupling.air, 0)
    simulation.advance(sim, [half + 3.0 * sim.setups[0].time_step])  # not at an exchange
    state = simulation.export_state(sim)
    simulation.advance(sim, [whole])
    stages.end, stages.moved = bits(sim, 0), simulation.snapshot(sim, 0)
    simulation.import_state(sim, state)
    simulation.advance(sim, [whole])
    stages.again, stages.before = bits(sim, 0), face_velocities(sim.coupling.air, 0)
    simulation.spin_up_wind(sim, 0, 0.5 * WIND)
    stages.slower = face_velocities(sim.coupling.air, 0)
    simulation.import_bed(sim, 0, rest)
    stages.put_back = simulation.snapshot(sim, 0)
    simulation.spin_up_wind(sim, 0, WIND, anew=True)
    stages.residual_momentum = sim.coupling.exchange.residual_momentum.to_numpy()
    return stages


@cache
def company(kind: str) -> SimpleNamespace:
    """The same bed between two others, on two workers; one of them does not move when its wind develops."""
    beds = [under(kind, 2), under(kind, 1), under(kind, 3, layers=2, speed=0.0)]
    sim, stages = simulation.assemble(beds, LAWS, Numerics("cpu", 2)), SimpleNamespace()
    simulation.spin_up_wind(sim, 2, WIND)
    stages.over_rest = simulation.air_profile(sim, 2)
    set_in(sim, WIND, *TIMES[kind])
    stages.end = bits(sim, 1)
    return stages


@kinds
def test_neighbours_threads_and_an_earlier_state_change_no_bit(kind):
    assert company(kind).end == alone(kind).again == alone(kind).end


@pytest.mark.slow
def test_workers_that_share_a_bed_under_a_grid_change_no_bit(same_in_teams):
    def blown(sim: Simulation) -> str:
        set_in(sim, WIND, *TIMES["grid"])
        return bits(sim, 0)

    same_in_teams(under("grid", 1), LAWS, blown)


@kinds
def test_a_bed_put_back_lies_where_it_lay_and_owes_nothing(kind):
    found = alone(kind)
    back, resting = found.put_back, found.resting
    assert np.array_equal(back.position, resting.position)
    assert np.array_equal(back.velocity[:, 2], resting.velocity[:, 2])
    assert not np.array_equal(back.position, found.moved.position)
    assert not found.residual_momentum.any()


def test_developed_air_hands_all_of_its_stress_to_grains_and_floor():
    wind = alone("column").developed
    height = np.diff(wind.face)
    floor = DENSITY * VISCOSITY * wind.void_fraction[0] * wind.velocity[0, 0] / (0.5 * height[0])
    taken = -(wind.drag[:, 0] * height).sum() + floor
    # Picard's rounds between drag and wind end when both agree to a few millionths
    assert taken == pytest.approx(DENSITY * WIND**2, rel=1e-4)


def test_developed_air_over_grains_at_rest_grows_with_height():
    wind = company("column").over_rest.velocity[:, 0]
    # stress that comes in at the lid only: drag on grains at rest and the floor take from it
    assert np.all(wind > 0.0)
    assert np.all(np.diff(wind) > 0.0)


def test_deep_air_moves_with_its_grains_and_no_faster():
    wind, grains = alone("column").developed, alone("column").resting.velocity[:, 0]
    assert grains.min() < 0.0 < grains.max()
    assert np.all(wind.velocity[:, 0] > grains.min())
    assert np.all(wind.velocity[wind.face[1:] < 2.0 * RADIUS, 0] < grains.max())


@pytest.mark.slow
def test_wind_on_a_grid_blows_over_the_bed_differs_from_place_to_place_and_keeps_its_eddies_when_it_slows():
    found = alone("grid")
    wind, flow = found.developed, found.flow
    centre = 0.5 * (wind.face[1:] + wind.face[:-1])
    assert np.abs(found.still.velocity).max() < 0.1 * WIND
    assert wind.velocity[centre > 0.5 * LID, 0].min() > 5.0 * WIND
    aloft = flow[0][:-1][..., centre > 2.0 * SURFACE]
    assert aloft.std(axis=(0, 1)).max() > 0.2 * WIND
    assert np.isfinite(aloft).all()
    for before, slower in zip(found.before, found.slower, strict=True):
        assert slower == pytest.approx(0.5 * before, rel=1e-12, abs=1e-12)


def test_a_gradient_puts_the_stress_of_the_wind_on_the_bed():
    assert -stress_gradient(under("grid", 1).air, WIND) * (LID - SURFACE) == pytest.approx(DENSITY * WIND**2)


@pytest.mark.slow
def test_a_grain_of_the_density_of_the_air_floats():
    density = 1e-6 / (4.0 / 3.0 * np.pi * RADIUS**3)
    still = weightless([(4e-3, 4e-3, 0.01)], air(np.linspace(0.0, 0.02, 14), density=density), look_steps=1)
    (state,) = final_states([replace(still, gravity=(0.3, 0.0, -9.81))], 0.01, "f64")
    assert np.abs(state.velocity).max() < 1e-12
