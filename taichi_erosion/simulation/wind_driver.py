"""Driving a grid of air over grains: its looks, and its wind, that is stirred or that swells with u*.

Driving the air of a running simulation, and reading it.
"""

from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.air.readback import set_velocities
from taichi_erosion.air.replica_step import advance_moving
from taichi_erosion.core.air_setup import bed_gradient
from taichi_erosion.core.initial_turbulence import stirred_wind
from taichi_erosion.core.setup import Floats, Integers
from taichi_erosion.core.snapshot import AirProfile
from taichi_erosion.core.transfer import download, read, upload, write
from taichi_erosion.coupling.grid_exchange import forget_debts, look_at_grids, meet_air
from taichi_erosion.coupling.spin_up import develop_air
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


Arrays = dict[str, NDArray[Any]]

# what the next step of the air depends on and a Setup does not state
AIR_GRIDS = (
    *("velocity_x", "velocity_y", "velocity_z", "pressure", "void_fraction", "void_before"),
    *("exchange_coefficient", "exchange_force", "eddy_face"),
)
EXCHANGE = ("owed", "rise", "lift", "through_flow")
AIR_NUMBERS = ("time", "friction_velocity")
# likewise of a grid of air alone
GRID_GRIDS = ("impulse", "gradient")
GRID_NUMBERS = ("driving_gradient",)
GRID_EXCHANGE = ("looked",)


def set_friction_velocity(sim: Simulation, replica: int, value: float) -> None:
    """Change the stress on the bed of one replica to rho u*^2; `value` is u* [m s-1] before its partition."""
    air, setup = sim.around.air, sim.setups[replica].air
    assert air is not None
    assert setup is not None
    reaching = value * sim.setups[replica].coupling.partition
    upload([(air.numbers.friction_velocity, [reaching])], replica)
    if not air.is_column:
        upload([(air.numbers.driving_gradient, [(bed_gradient(setup, reaching), 0.0, 0.0)])], replica)


def friction_velocity(sim: Simulation, replica: int) -> float:
    """u* [m s-1] before its partition, as `set_friction_velocity` was last told."""
    assert sim.around.air is not None
    reaching = download([sim.around.air.numbers.friction_velocity], replica, 1)[0][0]
    return float(reaching) / sim.setups[replica].coupling.partition


def develop_wind(sim: Simulation, replica: int, value: float, anew: bool = False) -> None:
    """Change u* [m s-1] and let the air of one replica find its steady profile before the grains move on.

    `anew` says that the grains have just been put back, and air and grains owe each other nothing. A grid
    has no steady profile: there `develop_eddies` says what happens.
    """
    assert sim.around.air is not None
    before = friction_velocity(sim, replica)
    set_friction_velocity(sim, replica, value)
    if sim.around.air.is_column:
        develop_air(replica, int(anew), sim.world, sim.around)
    else:
        part = sim.setups[replica].coupling.partition
        develop_eddies(sim, replica, part * before, part * value, anew)


def set_through_flow(sim: Simulation, replica: int, value: float) -> None:
    """Change the superficial velocity of the air that rises through a bed [m s-1]."""
    upload([(sim.around.exchange.through_flow, [value])], replica)


def air_profile(sim: Simulation, replica: int) -> AirProfile:
    """The air of one replica, layer by layer; of a grid the means over its columns."""
    air = sim.around.air
    assert air is not None
    setup = sim.setups[replica].air
    assert setup is not None

    def inner(field: Any) -> Floats:
        return read(field)[replica, 1:-1, 1:-1, 1:-1].mean(axis=(0, 1))

    velocity = np.stack([inner(air.velocity_x), inner(air.velocity_y)], axis=1)
    if air.is_column:
        drag = inner(air.exchange_force)[:, :2] - inner(air.exchange_coefficient)[:, None] * velocity
    else:
        drag = inner(air.impulse)[:, :2] / setup.time_step
    return AirProfile(
        face=np.asarray(setup.faces_z),
        velocity=velocity,
        void_fraction=inner(air.void_fraction),
        eddy_viscosity=inner(air.eddy_face),
        drag=drag,
        lift=read(sim.around.exchange.lift)[replica],
    )


def fields_carried(sim: Simulation) -> dict[str, Any]:
    """Fields of air and exchange that the next step depends on, by their names in a checkpoint."""
    air, exchange, apart = sim.around.air, sim.around.exchange, sim.around.apart
    if air is None:
        return {}
    found = {f"air_{name}": getattr(air, name) for name in AIR_GRIDS + GRID_GRIDS * apart}
    found |= {f"air_{name}": getattr(air.numbers, name) for name in AIR_NUMBERS + GRID_NUMBERS * apart}
    return found | {f"exchange_{name}": getattr(exchange, name) for name in EXCHANGE + GRID_EXCHANGE * apart}


def export_surroundings(sim: Simulation) -> Arrays:
    """State of air and exchange of all replicas; empty where there is no air."""
    return {name: read(field) for name, field in fields_carried(sim).items()}


def import_surroundings(sim: Simulation, state: Arrays) -> None:
    """Put an exported state of air and exchange back."""
    for name, field in fields_carried(sim).items():
        write(field, state[name])
