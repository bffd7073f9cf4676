"""Wind of a running simulation: friction velocity, spin-up, exchanges of a grid of air, and profiles."""

from math import ceil
from typing import Any

import numpy as np

from taichi_erosion.air.grid import Air
from taichi_erosion.air.readback import set_velocities
from taichi_erosion.air.step import advance_active_replicas
from taichi_erosion.core.air_setup import AirSetup, initial_wind, stress_gradient
from taichi_erosion.core.setup import Floats, Integers
from taichi_erosion.core.snapshot import AirProfile
from taichi_erosion.core.transfer import download, download_field, upload, write_field
from taichi_erosion.coupling.exchange import spin_up_column
from taichi_erosion.coupling.grid_exchange import exchange_with_grids, match_air_to_grains
from taichi_erosion.simulation.assemble import Simulation


def air_on_device(sim: Simulation, replica: int) -> tuple[Air, AirSetup]:
    """Air on the device, and its setup in one replica; for runs with air alone."""
    air, setup = sim.coupling.air, sim.setups[replica].air
    assert air is not None
    assert setup is not None
    return air, setup


def exchange_air_if_due(sim: Simulation, going: Any) -> Integers:
    """Exchange of those of the `going` replicas that are due; returns the steps to the next exchange of each.

    Before the first exchange of all, the drag terms are set without advancing the air.
    """
    replicas, exchange, count = sim.world.replicas, sim.coupling.exchange, len(sim.setups)
    columns = [replicas.step, exchange.look_steps, exchange.last_exchange]
    step, every, last = (column.astype(np.int64) for column in download(columns, 0, count))
    due = going & (step % every == 0) & (last != step)
    if (due & (last < 0)).any():
        select_replicas_of_grids(sim, due & (last < 0))
        match_air_to_grains(sim.world, sim.coupling, count, sim.chunk)
    if due.any():
        select_replicas_of_grids(sim, due)
        exchange_with_grids(sim.world, sim.coupling, count, sim.chunk)
    return (every - step % every).astype(np.int32)


def select_replicas_of_grids(sim: Simulation, moving: Any) -> None:
    """Select the replicas that the kernels of grids act on."""
    upload([(air_on_device(sim, 0)[0].active, moving)])


def change_grid_wind(sim: Simulation, replica: int, before: float, after: float, anew: bool) -> None:
    """Change the flow of a grid from one friction velocity [m s-1] at the bed to another.

    Wind that starts from rest has initial turbulence and develops over grains that keep their places. A wind
    that changes keeps its eddies: all velocities grow with u*, all pressures with its square.
    """
    (air, setup), count = air_on_device(sim, replica), len(sim.setups)
    if before > 0.0 or after == 0.0:
        factor = after / before if before > 0.0 else 0.0
        for field, power in (*((part, 1) for part in air.velocities), (air.pressure, 2), (air.gradient, 2)):
            whole = download_field(field)
            whole[replica] *= factor**power
            write_field(field, whole)
    else:
        u, v, w = initial_wind(setup, after)
        set_velocities(air, replica, (u, v, w))
    select_replicas_of_grids(sim, np.arange(count) == replica)
    match_air_to_grains(sim.world, sim.coupling, count, sim.chunk)
    if anew:
        residual = download_field(sim.coupling.exchange.residual_momentum)
        residual[replica] = 0.0
        write_field(sim.coupling.exchange.residual_momentum, residual)
    if before == 0.0 and after > 0.0:
        assert setup.initial_turbulence is not None
        time = setup.initial_turbulence.turnovers * (setup.high[2] - setup.ground) / after
        for _ in range(ceil(time / setup.time_step)):
            advance_active_replicas(air, count, sim.chunk)
            match_air_to_grains(sim.world, sim.coupling, count, sim.chunk)


def friction_velocity(sim: Simulation, replica: int) -> float:
    """u* [m s-1] before its partition, as set last."""
    reaching = download([air_on_device(sim, replica)[0].numbers.friction_velocity], replica, 1)[0][0]
    return float(reaching) / sim.setups[replica].coupling.partition


def spin_up_wind(sim: Simulation, replica: int, value: float, anew: bool = False) -> None:
    """Change u* [m s-1] and advance the air of one replica to its steady profile before the grains move on.

    `value` is u* before its partition. `anew`: the grains have just been put back, and the residual momentum
    is cleared. A grid has no steady profile: see `change_grid_wind`.
    """
    (air, setup), part = air_on_device(sim, replica), sim.setups[replica].coupling.partition
    before = friction_velocity(sim, replica)
    upload([(air.numbers.friction_velocity, [value * part])], replica)
    if air.is_column:
        spin_up_column(sim.world, sim.coupling, replica, anew)
    else:
        upload([(air.numbers.driving_gradient, [(stress_gradient(setup, value * part), 0.0, 0.0)])], replica)
        change_grid_wind(sim, replica, part * before, part * value, anew)


def set_upflow(sim: Simulation, replica: int, value: float) -> None:
    """Change the superficial velocity of the air that rises through a bed [m s-1]."""
    upload([(sim.coupling.exchange.through_flow, [value])], replica)


def air_profile(sim: Simulation, replica: int) -> AirProfile:
    """The air of one replica, layer by layer; of a grid the means over its columns."""
    air, setup = air_on_device(sim, replica)

    def inside(field: Any) -> Floats:
        return download_field(field)[replica, 1:-1, 1:-1, 1:-1].mean(axis=(0, 1))

    velocity = np.stack([inside(air.velocity_x), inside(air.velocity_y)], axis=1)
    if air.is_column:
        drag = inside(air.exchange_force)[:, :2] - inside(air.exchange_coefficient)[:, None] * velocity
    else:
        drag = inside(air.impulse)[:, :2] / setup.time_step
    return AirProfile(
        face=np.asarray(setup.faces_z),
        velocity=velocity,
        void_fraction=inside(air.void_fraction),
        eddy_viscosity=inside(air.eddy_face),
        drag=drag,
        lift=download_field(sim.coupling.exchange.pressure_lift)[replica],
    )
