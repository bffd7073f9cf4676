"""First impacts of a run: every pair of its materials collides, before the first step.

Two grains, or a grain and a wall, collide head-on at a stated speed, with the contact laws, tables and time
step of the run; the rebound speed is compared with the stated restitution.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from taichi_erosion.core.setup import Setup, pair_row
from taichi_erosion.core.ti import ti
from taichi_erosion.grains.materials import device_rows
from taichi_erosion.simulation.assemble import Simulation

STEPS_MOST = 100_000  # a pair that has not parted by then sticks


@dataclass(frozen=True)
class Impact:
    """One pair of materials and its measured restitution."""

    replica: int
    pair: str  # as `contact` names it
    speed: float  # m s-1, before
    stated: float  # coefficient of restitution in the table [1]
    found: float  # speed after over speed before [1], 0 where the pair sticks
    adhesive: bool  # adhesion takes a share of the speed that the table does not state


@dataclass(frozen=True)
class ImpactCase:
    """Input of one impact."""

    replica: int
    pair: str
    row: int  # of the replica's contact table
    root_radius: float  # m^0.5, square root of the effective radius
    mass: float  # kg, effective


@ti.kernel
def simulate_impacts(
    # in
    world: ti.template(),
    row: ti.types.ndarray(dtype=ti.i32, ndim=1),
    root_radius: ti.types.ndarray(dtype=ti.f64, ndim=1),
    mass: ti.types.ndarray(dtype=ti.f64, ndim=1),
    time_step: ti.types.ndarray(dtype=ti.f64, ndim=1),
    # out
    speed_out: ti.types.ndarray(dtype=ti.f64, ndim=1),
):
    """Replace closing speeds by rebound speeds [m s-1]."""
    for k in range(row.shape[0]):
        root, inertia = ti.cast(root_radius[k], float), ti.cast(mass[k], float)
        dt, closing = ti.cast(time_step[k], float), ti.cast(speed_out[k], float)
        damping = world.materials.damping[row[k]] * ti.sqrt(inertia)
        overlap = 0.0 * dt
        step = 0
        while step < STEPS_MOST:
            force, radius, _, acts = world.laws.normal_force(world.materials, row[k], overlap, root, 1)
            if acts == 0 and closing < 0.0:
                step = STEPS_MOST + 1
            else:
                closing -= ti.cast(acts, float) * (force + damping * ti.sqrt(radius) * closing) / inertia * dt
                overlap += closing * dt
                step += 1
        speed_out[k] = ti.select(step > STEPS_MOST, -ti.cast(closing, ti.f64), 0.0)


def impact_cases(replica: int, setup: Setup) -> Iterator[ImpactCase]:
    """Every pair of materials that can collide, with the smallest grain: its contacts are the shortest."""
    smallest = int(np.argmin(setup.grains.radius))
    radius, mass = float(setup.grains.radius[smallest]), float(setup.grains.mass[smallest])
    grain = int(setup.grains.material[smallest])
    walls = sorted({surface.material for surface in setup.surfaces})
    for other, share in [(grain, 0.5), *((wall, 1.0) for wall in walls)]:
        pair = f"{setup.materials[grain]}-{setup.materials[other]}"
        row = pair_row(grain, other, len(setup.materials))
        yield ImpactCase(replica, pair, row, float(np.sqrt(share * radius)), share * mass)


def first_impacts(sim: Simulation, speeds: Sequence[float]) -> list[Impact]:
    """Impacts of all pairs of all replicas, at one speed a replica [m s-1]."""
    cases = [case for r, setup in enumerate(sim.setups) for case in impact_cases(r, setup)]
    own = [device_rows(sim.world.materials, setup.contacts) for setup in sim.setups]
    rows = np.array([c.replica * sim.world.materials.rows + own[c.replica][c.row] for c in cases], np.int32)
    root_radius, mass = (np.array([getattr(c, name) for c in cases]) for name in ("root_radius", "mass"))
    steps = np.array([sim.setups[c.replica].time_step for c in cases])
    after = np.array([speeds[c.replica] for c in cases], np.float64)
    simulate_impacts(sim.world, rows, root_radius, mass, steps, after)
    impacts = []
    for c, rebound in zip(cases, after, strict=True):
        table, speed = sim.setups[c.replica].contacts, speeds[c.replica]
        stated, sticky = float(table.restitution[c.row]), float(table.surface_energy[c.row]) > 0.0
        impacts.append(Impact(c.replica, c.pair, speed, stated, float(rebound) / speed, sticky))
    return impacts
