"""Small scenes of grains in a column of air: one grain, a regular bed, a bed that was poured.

V30: quartz spheres of 50 um to 2 mm fall through still air at their terminal velocities.

The numbers wanted are the published table's, four digits each; a second line holds the same run against the
balance of weight, buoyancy and drag, solved in NumPy. The step is a fifth to a ten-thousandth of the drag's
response, and drag is taken implicitly: what is left is rounding and the lag of the rate by one look.

V32: what air gives to grains it loses, and a grain's volume is shared out among its layers without rest.

Grains of two sizes fly through sheared air, along and across it, each level with a velocity of its own, and
reach through many layers each; some reach below the floor and above the lid. Floor and lid exert no stress,
so the momentum of air, grains and what is still owed is that of the start. Its change is counted over all
that was exchanged. In single precision the drag on a grain is the change of its rounded velocity, so that
the books are as exact as the sum over one interval.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.air_setup import SIDES, AirModel, AirSetup, AirSide
from taichi_erosion.core.setup import Coupling, GrainTable, Laws, PrimitiveTable, Setup
from taichi_erosion.simulation import Simulation, advance, air_profile, snapshot
from taichi_erosion.verification.claim import Outcome, Precision, below, relative
from taichi_erosion.verification.reference.flow import Stream, terminal_velocity
from taichi_erosion.verification.small_scenes import (
    Touch,
    bench,
    contact_table,
    final_states,
    sphere_setup,
    spheres,
)

Floats = NDArray[np.float64]
Patch = tuple[float, float]  # m, periods downwind and across

GRAVITY = (0.0, 0.0, -9.81)  # m s-2


def still_air(faces: Floats, patch: Patch, density: float, viscosity: float) -> AirSetup:
    """A column of air at rest that nothing but grains can move; `viscosity` is dynamic [Pa s].

    Its floor is smooth and its lid without stress: what the air gains, grains have lost.
    """
    ends = {"z_low": AirSide("symmetry"), "z_high": AirSide("stress")}
    return AirSetup(
        cells=(1, 1, len(faces) - 1),
        low=(0.0, 0.0, float(faces[0])),
        high=(*patch, float(faces[-1])),
        faces_z=faces,
        sides={name: ends.get(name, AirSide("periodic")) for name in SIDES},
        density=density,
        viscosity=viscosity / density,
        time_step=1.0,
        model=AirModel(closure="none", advection="none", scheme="euler", exchange=True),
    )


def in_air(setup: Setup, air: AirSetup, coupling: Coupling, headroom: float) -> Setup:
    """The same grains in a periodic patch; they may rise `headroom` [m] above the lid."""
    low = (0.0, 0.0, air.faces_z[0] - headroom)
    high = (air.high[0], air.high[1], air.high[2] + headroom)
    return replace(
        setup, air=air, coupling=coupling, domain=(low, high), period=(air.high[0], air.high[1], 0.0)
    )


def grains_in_air(
    grains: GrainTable, air: AirSetup, time_step: float, touch: Touch, walls: PrimitiveTable | None = None
) -> Setup:
    """Grains without weight in a periodic patch of air."""
    setup = sphere_setup(grains, contact_table(touch, touch), time_step, walls)
    return in_air(setup, air, Coupling(look_steps=1), 1.0)


def regular_bed(diameter: float, density: float, void: float, cells: tuple[int, int, int]) -> GrainTable:
    """A face-centred cubic lattice of spheres from the origin that leaves `void` of its volume free."""
    edge = lattice_edge(diameter, void)
    base = edge * np.array([(0.25, 0.25, 0.25), (0.75, 0.75, 0.25), (0.25, 0.75, 0.75), (0.75, 0.25, 0.75)])
    corner = edge * np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), axis=-1).reshape(-1, 1, 3)
    place = (corner + base).reshape(-1, 3)
    return spheres(place, 0.0, 0.0, diameter / 2.0, density * np.pi / 6.0 * diameter**3)


def lattice_edge(diameter: float, void: float) -> float:
    """Edge of a face-centred cubic cell, which holds four spheres [m]."""
    return float((4.0 * np.pi / 6.0 / (1.0 - void)) ** (1.0 / 3.0) * diameter)


AIR = Stream(0.0, 1.0, density=1.225, viscosity=1.789e-5)
QUARTZ = 2650.0  # kg m-3
TERMINAL = {50: 0.1820, 100: 0.5815, 200: 1.4778, 250: 1.9070, 500: 3.826, 1000: 7.042, 2000: 11.34}
FALL_HEIGHT, FALL_SIDE, FALL_LAYERS = 120.0, 1.0, 30  # m, m, 1: so much air that one grain does not move it
FALL_STEP, FALL = 2e-4, 9.0  # s
START = 115.0  # m


def falling(diameter: float) -> Setup:
    """One grain high above the floor."""
    grain = spheres((0.5, 0.5, START), 0.0, 0.0, diameter / 2.0, QUARTZ * np.pi / 6.0 * diameter**3)
    touch = Touch(1e7, 1e7)
    setup = sphere_setup(grain, contact_table(touch, touch), FALL_STEP, gravity=GRAVITY)
    air = still_air(
        np.linspace(0.0, FALL_HEIGHT, FALL_LAYERS + 1), (FALL_SIDE, FALL_SIDE), AIR.density, AIR.viscosity
    )
    return in_air(setup, air, Coupling(look_steps=5), 1.0)


def terminal_velocities() -> Iterator[Outcome]:
    """V30."""
    setups = [falling(1e-6 * microns) for microns in TERMINAL]
    speeds = [-state.velocity[0, 2] for state in final_states(setups, FALL, "f64")]
    for (microns, wanted), speed in zip(TERMINAL.items(), speeds, strict=True):
        yield relative(f"terminal velocity of {microns} um quartz [m/s]", speed, wanted, 0.005, "f64")
    balance = [terminal_velocity(1e-6 * microns, QUARTZ, AIR) for microns in TERMINAL]
    error = np.array(speeds) / balance - 1.0
    yield below("terminal velocities against the balance of forces: error", error, 1e-4, "f64")


SIDE, HEIGHT = 5e-3, 4e-3  # m
LAYERS = 37  # thinner than the grains, and no face where a grain begins
DENSITY, VISCOSITY = 1.225, 1.789e-5  # kg m-3, Pa s
SOLID = 2650.0  # kg m-3
STEP, STEPS, LOOK = 2e-6, 2000, 7  # s, 1, 1
LIMIT: dict[Precision, float] = {"f64": 1e-12, "f32": 1e-6}


@dataclass(frozen=True)
class Momenta:
    """Horizontal momentum of all air and all grains, and what is on the way [kg m s-1]."""

    air: Floats
    grains: Floats
    residual_momentum: Floats

    @property
    def total(self) -> Floats:
        """What nothing can change."""
        return self.air + self.grains + self.residual_momentum


def crossing_grains() -> Setup:
    """Grains on levels of equal height, so that they stay in their layers, against a sheared wind."""
    rng = np.random.default_rng(3)
    levels = np.array([0.0, 0.61, 1.37, 2.3, 3.1, 4.0]) * 1e-3
    across = np.linspace(0.1, 0.9, 6)
    x, y = (grid.ravel() for grid in np.meshgrid(across, across, indexing="ij"))
    place = np.concatenate([np.column_stack([SIDE * x, SIDE * y, np.full(36, z)]) for z in levels])
    radius = np.where(np.arange(len(place)) % 72 < 36, 1.5e-4, 2.2e-4)
    velocity = np.repeat(np.column_stack([rng.normal(0.0, 1.0, (6, 2)), np.zeros(6)]), 36, axis=0)
    grains = spheres(place, velocity, 0.0, radius, SOLID * 4.0 / 3.0 * np.pi * radius**3)
    touch = Touch(1e7, 1e7, restitution=0.7)
    setup = sphere_setup(grains, contact_table(touch, touch), STEP)
    faces = np.linspace(0.0, HEIGHT, LAYERS + 1)
    air = still_air(faces, (SIDE, SIDE), DENSITY, VISCOSITY)
    middle = 0.5 * (faces[1:] + faces[:-1])
    sheared = replace(air, start=3.0 * middle / HEIGHT)
    return in_air(setup, sheared, Coupling(look_steps=LOOK), HEIGHT)


def momenta(sim: Simulation) -> Momenta:
    """All momentum of the first replica."""
    profile, state = air_profile(sim, 0), snapshot(sim, 0)
    volume = profile.void_fraction * np.diff(profile.face) * SIDE * SIDE
    # what drag has given since the last look is not yet off the books
    side = int(sim.world.replicas.side[0])
    rows = slice(side * sim.capacities.grains, side * sim.capacities.grains + len(state.mass))
    mass = 1.0 / sim.world.grains.mass_inverse.to_numpy()[rows].astype(np.float64)
    pending = (mass[:, None] * sim.world.frozen_drag.drag_kick.to_numpy()[rows]).sum(axis=0)
    residual_momentum = sim.coupling.exchange.residual_momentum.to_numpy()[0].sum(axis=0) - pending
    velocity = sim.world.grains.velocity.to_numpy()[rows].astype(np.float64)
    return Momenta(
        DENSITY * (volume[:, None] * profile.velocity).sum(axis=0),
        (mass[:, None] * velocity).sum(axis=0)[:2],
        residual_momentum[:2],
    )


def action_and_reaction() -> Iterator[Outcome]:
    """V32."""
    setup = crossing_grains()
    solid = float((4.0 / 3.0 * np.pi * setup.grains.radius**3).sum())
    for precision, limit in LIMIT.items():
        sim = bench([setup], precision, Laws(drag="two_limits"))
        # the first look counts the grains; air that they displace before it has no momentum to compare with
        advance(sim, [STEP])
        before = momenta(sim)
        advance(sim, [STEP * STEPS])
        after = momenta(sim)
        exchanged = np.abs(after.grains - before.grains).max()
        change = (after.total - before.total) / exchanged
        yield below("momentum of air and grains: change over what was exchanged", change, limit, precision)
        profile = air_profile(sim, 0)
        filled = (1.0 - profile.void_fraction) * np.diff(profile.face) * SIDE * SIDE
        share = filled.sum() / solid - 1.0
        yield below("volume of grains found in the layers: error", share, limit, precision)
