"""V32: what air gives to grains it loses, and a grain's volume is shared out among its layers without rest.

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

from taichi_erosion.core.setup import Coupling, Laws, Setup
from taichi_erosion.simulation import Simulation, advance, air_profile, snapshot
from taichi_erosion.verification.bench_run import bench
from taichi_erosion.verification.bench_setup import Touch, contact_table, sphere_setup, spheres
from taichi_erosion.verification.claim import Outcome, Precision, below
from taichi_erosion.verification.coupled_setup import in_air, still_air

Floats = NDArray[np.float64]

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
    owed: Floats

    @property
    def total(self) -> Floats:
        """What nothing can change."""
        return self.air + self.grains + self.owed


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
    rows = slice(side * sim.sizes.grains, side * sim.sizes.grains + len(state.mass))
    mass = 1.0 / sim.world.grains.mass_inverse.to_numpy()[rows].astype(np.float64)
    pending = (mass[:, None] * sim.world.held.dragged.to_numpy()[rows]).sum(axis=0)
    owed = sim.around.exchange.owed.to_numpy()[0].sum(axis=0) - pending
    velocity = sim.world.grains.velocity.to_numpy()[rows].astype(np.float64)
    return Momenta(
        DENSITY * (volume[:, None] * profile.velocity).sum(axis=0),
        (mass[:, None] * velocity).sum(axis=0)[:2],
        owed[:2],
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
