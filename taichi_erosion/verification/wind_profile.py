"""V28: a logarithmic wind survives an empty tunnel, and the stress in a channel is linear.

Wind enters with  u = (u*/kappa) ln((z + z0) / z0)  over a rough floor, under a lid that pulls with rho u*^2:
nothing may change over the fetch. In a channel driven by a mean pressure gradient G the total stress is

    tau = rho u*^2 (1 - z / H),    rho u*^2 = -G H,

whatever the closure; over a smooth floor the mixing length gives u+ = z+ in the viscous sublayer and the law
of the wall above, u+ = ln(z+) / kappa + 5.2 (kappa = 0.40 and R_c = 7 leave 0.3 of scatter about it).

Reference: Richards & Hoxey (1993), J. Wind Eng. Ind. Aerodyn. 46-47, 145-153.
"""

from collections.abc import Iterator

import numpy as np

from taichi_erosion.air.column import advance_columns
from taichi_erosion.air.observe import air_snapshot
from taichi_erosion.air.step import advance_air
from taichi_erosion.core.air_setup import (
    AirModel,
    AirSetup,
    AirSide,
    log_profile,
    stretched_faces,
)
from taichi_erosion.core.air_snapshot import AirSnapshot
from taichi_erosion.verification.air_bench import aired, box, centres, sides
from taichi_erosion.verification.claim import Outcome, below, relative

KARMAN, DENSITY, VISCOSITY = 0.40, 1.2, 1.5e-5  # 1, kg m-3, m2 s-1
FRICTION, ROUGHNESS = 0.3, 1e-4  # m s-1, m
FETCH, HEIGHT = 5.0, 0.5  # m
CELLS, LAYERS, LOWEST = 64, 32, 5e-3  # 1, 1, m
FETCH_STEP, FETCH_STEPS = 5e-3, 200  # s, 1: Courant number 0.5 at the lid, one passage of the slowest cell
CHANNEL_HEIGHT, CHANNEL_LAYERS, CHANNEL_LOWEST = 0.05, 96, 2e-5  # m, 1, m: u* z / nu = 0.4
CHANNEL_STEP, CHANNEL_STEPS = 0.05, 4000  # s, 1
SUBLAYER, LOG_LAYER = 4.0, (40.0, 0.2)  # in wall units: below, from; share of the height up to


def fetch() -> AirSetup:
    """Empty tunnel."""
    faces = stretched_faces(0.0, HEIGHT, LAYERS, LOWEST)
    profile = log_profile(centres(faces), FRICTION, ROUGHNESS, KARMAN)
    around = sides(
        x_low=AirSide("inlet", (1.0, 0.0, 0.0)),
        x_high=AirSide("outlet"),
        y_low=AirSide("symmetry"),
        y_high=AirSide("symmetry"),
        z_low=AirSide("rough", roughness=ROUGHNESS),
        z_high=AirSide("stress"),
    )
    return box(
        (CELLS, 1, LAYERS),
        (FETCH, 0.1, HEIGHT),
        faces_z=faces,
        sides=around,
        density=DENSITY,
        viscosity=VISCOSITY,
        time_step=FETCH_STEP,
        model=AirModel(closure="mixing_length"),
        implicitness=1.0,
        friction_velocity=FRICTION,
        inlet_shape=profile,
        start=profile,
    )


def channel() -> AirSetup:
    """Half a channel over a smooth floor, driven by a mean pressure gradient."""
    faces = stretched_faces(0.0, CHANNEL_HEIGHT, CHANNEL_LAYERS, CHANNEL_LOWEST)
    return box(
        (1, 1, CHANNEL_LAYERS),
        (0.1, 0.1, CHANNEL_HEIGHT),
        faces_z=faces,
        sides=sides(z_low=AirSide("wall")),
        density=DENSITY,
        viscosity=VISCOSITY,
        time_step=CHANNEL_STEP,
        model=AirModel(closure="mixing_length", advection="none", scheme="euler"),
        implicitness=1.0,
        driving_gradient=(-DENSITY * FRICTION**2 / CHANNEL_HEIGHT, 0.0, 0.0),
        start=log_profile(centres(faces), FRICTION, 0.11 * VISCOSITY / FRICTION, KARMAN),
    )


def kept_profile() -> Iterator[Outcome]:
    """The wind at the end of the fetch is that at its beginning."""
    setup = fetch()
    air = aired([setup])
    advance_air(air, FETCH_STEPS)
    state = air_snapshot(air, 0)
    assert setup.inlet_shape is not None
    off = state.velocity[:, 0, :, 0] / setup.inlet_shape - 1.0
    yield below("log wind over the fetch: change of the speed, relative", off, 0.02, "f64")
    friction = state.friction_velocity[:, 0] / FRICTION - 1.0
    yield below("log wind over the fetch: change of u* at the floor, relative", friction, 0.02, "f64")


def wall_units(state: AirSnapshot) -> Iterator[Outcome]:
    """Sublayer and law of the wall."""
    height, speed = state.z * FRICTION / VISCOSITY, state.velocity[0, 0, :, 0] / FRICTION
    low = height < SUBLAYER
    yield below("viscous sublayer: u+ over z+ less 1", speed[low] / height[low] - 1.0, 0.03, "f64")
    middle = (height > LOG_LAYER[0]) & (state.z < LOG_LAYER[1] * CHANNEL_HEIGHT)
    law = np.log(height[middle]) / KARMAN + 5.2
    # the stress falls off by 1 - z/H, which the law of the wall does not know: up to 3 % of u+ at z = H/5
    yield below("law of the wall: u+ off ln(z+)/kappa + 5.2", speed[middle] - law, 0.8, "f64")


def linear_stress() -> Iterator[Outcome]:
    """Total stress against height, and the friction velocity that the gradient implies."""
    air = aired([channel()])
    advance_columns(CHANNEL_STEPS, air)
    state = air_snapshot(air, 0)
    viscosity = state.viscosity + state.eddy_viscosity[0, 0, 1:-1]
    stress = state.density * viscosity * np.diff(state.velocity[0, 0, :, 0]) / np.diff(state.z)
    wall = DENSITY * FRICTION**2
    off = stress / wall - (1.0 - state.faces_z[1:-1] / CHANNEL_HEIGHT)
    yield below("channel: total stress off a straight line, over that of the floor", off, 1e-3, "f64")
    yield relative("channel: u* of the floor [m/s]", state.friction_velocity[0, 0], FRICTION, 1e-3, "f64")
    yield from wall_units(state)


def wind_profile() -> Iterator[Outcome]:
    """V28."""
    yield from kept_profile()
    yield from linear_stress()
