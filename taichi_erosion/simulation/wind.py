"""Driving the air of a running simulation, and reading it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.air_setup import bed_gradient
from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import AirProfile
from taichi_erosion.core.transfer import download, read, upload, write
from taichi_erosion.coupling.develop import develop_air
from taichi_erosion.simulation.assemble import Simulation
from taichi_erosion.simulation.eddies import develop_eddies

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
