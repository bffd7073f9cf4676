"""A grid of air over a bed: the same bits alone, in company, on two threads, resumed; eddies that start."""

from dataclasses import replace

import numpy as np
import pytest
from grain_worlds import fingerprint
from windy_beds import DENSITY, LID, RADIUS, SURFACE, bed, set_in

from taichi_erosion import simulation
from taichi_erosion.air.readback import face_velocities
from taichi_erosion.core.air_setup import AirModel, AirSide, InitialTurbulence, bed_gradient
from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Laws, Numerics

LAWS = Laws(rolling="elastic_plastic", drag="two_limits")
HALF, WHOLE = 0.001, 0.002  # s
WIND = 0.3  # m s-1, friction velocity
TURNOVERS = 0.1


def gridded(seed: int, **words):
    """The bed of `windy_beds` under a grid of air that eddies may stir."""
    table = bed(seed, **words)
    air = replace(
        table.air,
        cells=(4, 4, table.air.cells[2]),
        sides=table.air.sides | {"z_high": AirSide("symmetry")},
        model=AirModel("smagorinsky", exchange=True),
        time_step=5.0 * table.time_step,
        ground=SURFACE,
        initial_turbulence=InitialTurbulence(1.0, TURNOVERS, RADIUS / 15.0, seed),
    )
    return replace(table, air=air)


def bits(sim, replica: int) -> str:
    wind = b"".join(part.tobytes() for part in face_velocities(sim.coupling.air, replica))
    return fingerprint(simulation.snapshot(sim, replica)) + wind.hex()


def blow(sim, replica: int) -> str:
    """A little without wind, as much with; the bits of grains and air at the end."""
    set_in(sim, WIND, HALF, WHOLE)
    return bits(sim, replica)


@pytest.fixture(scope="module")
def alone():
    """One bed on one thread, with its state at half time, and what follows from that state again."""
    sim = simulation.assemble([gridded(1)], LAWS, Numerics("cpu", 1))
    simulation.advance(sim, [HALF])
    still = simulation.air_profile(sim, 0)
    simulation.spin_up_wind(sim, 0, WIND)
    developed, flow = simulation.air_profile(sim, 0), face_velocities(sim.coupling.air, 0)
    between = HALF + 3.0 * sim.setups[0].time_step  # not at an exchange
    simulation.advance(sim, [between])
    state = simulation.export_state(sim)
    simulation.advance(sim, [WHOLE])
    end, air = bits(sim, 0), simulation.air_profile(sim, 0)
    simulation.import_state(sim, state)
    simulation.advance(sim, [WHOLE])
    again = bits(sim, 0)
    before = face_velocities(sim.coupling.air, 0)
    simulation.spin_up_wind(sim, 0, 0.5 * WIND)
    slower = face_velocities(sim.coupling.air, 0)
    stop_device()
    return locals()


@pytest.mark.slow
def test_neighbours_threads_and_an_earlier_state_change_no_bit(alone):
    assert alone["again"] == alone["end"]
    sim = simulation.assemble([gridded(2), gridded(1), gridded(3, layers=2)], LAWS, Numerics("cpu", 2))
    assert blow(sim, 1) == alone["end"]
    stop_device()


@pytest.mark.slow
def test_workers_that_share_a_bed_under_a_grid_change_no_bit(in_teams):
    one, two, uneven = in_teams(gridded(1), LAWS, lambda sim: blow(sim, 0))
    assert one == two == uneven


@pytest.mark.slow
def test_wind_that_sets_in_blows_over_the_bed_and_differs_from_place_to_place(alone):
    wind, flow = alone["developed"], alone["flow"]
    centre = 0.5 * (wind.face[1:] + wind.face[:-1])
    assert np.abs(alone["still"].velocity).max() < 0.1 * WIND
    assert wind.velocity[centre > 0.5 * LID, 0].min() > 5.0 * WIND
    aloft = flow[0][:-1][..., centre > 2.0 * SURFACE]
    assert aloft.std(axis=(0, 1)).max() > 0.2 * WIND
    assert np.isfinite(aloft).all()


@pytest.mark.slow
def test_a_wind_that_changes_keeps_its_eddies(alone):
    for before, slower in zip(alone["before"], alone["slower"], strict=True):
        assert slower == pytest.approx(0.5 * before, rel=1e-12, abs=1e-12)


def test_a_gradient_puts_the_stress_of_the_wind_on_the_bed():
    air = gridded(1).air
    assert air is not None
    assert -bed_gradient(air, WIND) * (LID - SURFACE) == pytest.approx(DENSITY * WIND**2)
