"""Driving a grid of air over grains: its looks, and its wind, that is stirred or that swells with u*."""

from math import ceil
from typing import Any

import numpy as np

from taichi_erosion.air.observe import set_velocities
from taichi_erosion.air.replica import advance_moving
from taichi_erosion.core.setup import Integers
from taichi_erosion.core.stir import stirred_wind
from taichi_erosion.core.transfer import download, read, upload, write
from taichi_erosion.coupling.patch import forget_debts, look_at_grids, meet_air
from taichi_erosion.simulation.assemble import Simulation


def look_now(sim: Simulation, going: Any) -> Integers:
    """Let those of the `going` replicas look whose time it is; returns the steps to the next look of each.

    The first of all looks is taken twice, at first without the air: it must know the grains before.
    """
    replicas, exchange, count = sim.world.replicas, sim.around.exchange, len(sim.setups)
    columns = [replicas.step, exchange.look_steps, exchange.looked]
    step, every, looked = (column.astype(np.int64) for column in download(columns, 0, count))
    due = going & (step % every == 0) & (looked != step)
    if (due & (looked < 0)).any():
        choose_moving(sim, due & (looked < 0))
        meet_air(sim.world, sim.around, count, sim.chunk)
    if due.any():
        choose_moving(sim, due)
        look_at_grids(sim.world, sim.around, count, sim.chunk)
    return (every - step % every).astype(np.int32)


def choose_moving(sim: Simulation, moving: Any) -> None:
    """Say which replicas take part."""
    assert sim.around.air is not None
    upload([(sim.around.air.moving, moving)])


def develop_eddies(sim: Simulation, replica: int, before: float, after: float, anew: bool) -> None:
    """Change the flow of a grid from one friction velocity [m s-1] at the bed to another.

    Wind that sets in is stirred and grows its eddies over grains that keep their places. A wind that changes
    keeps its eddies: all velocities grow with u*, all pressures with its square.
    """
    air, setup = sim.around.air, sim.setups[replica].air
    assert air is not None
    assert setup is not None
    if before > 0.0 or after == 0.0:
        factor = after / before if before > 0.0 else 0.0
        for field, power in (*((part, 1) for part in air.velocities), (air.pressure, 2), (air.gradient, 2)):
            whole = read(field)
            whole[replica] *= factor**power
            write(field, whole)
    else:
        u, v, w = stirred_wind(setup, after)
        set_velocities(air, replica, (u, v, w))
    choose_moving(sim, np.arange(len(sim.setups)) == replica)
    meet_air(sim.world, sim.around, len(sim.setups), sim.chunk)
    if anew:
        forget_debts(sim.world, sim.around, len(sim.setups), sim.chunk)
    if before == 0.0 and after > 0.0:
        grow_eddies(sim, replica, after)


def grow_eddies(sim: Simulation, replica: int, friction_velocity: float) -> None:
    """Let the air flow over resting grains for the stated number of turnovers."""
    setup = sim.setups[replica].air
    assert setup is not None
    assert setup.stir is not None
    assert sim.around.air is not None
    time = setup.stir.turnovers * (setup.high[2] - setup.ground) / friction_velocity
    count = len(sim.setups)
    for _ in range(ceil(time / setup.time_step)):
        advance_moving(sim.around.air, count, sim.chunk)
        meet_air(sim.world, sim.around, count, sim.chunk)
