"""Momentum that grains give each other in one step: none, up to rounding.

    sum of F = 0

F is the force between grains as the step gathers it from the buffers of all partitions, so a reaction that
is lost among lists, buffers and workers shows. The memory of the contacts is put aside meanwhile, in the
side of the lists that waits for the next rebuild: the run goes on bit for bit as if nobody had looked.

A first impact of every pair of materials, with the contact laws, tables and time step of the run itself.

Two grains, or a grain and a wall, meet head-on at a stated speed, and their distance is followed by the
scheme of the run. What the compiled law gives back of the speed can then be held against what is stated.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from taichi_erosion.core.setup import Setup, pair_row
from taichi_erosion.core.ti import ti
from taichi_erosion.grains.integrate import gather_forces
from taichi_erosion.grains.neighbour_list import entry_block
from taichi_erosion.grains.pair_contacts import add_pair_forces
from taichi_erosion.grains.state import force_block, partition_first, side_block
from taichi_erosion.simulation.assemble import Simulation


@ti.func
def copy_memory(world_out: ti.template(), r, source, target):
    """Copy what contacts remember from one side of the lists to the other, entry by entry."""
    (pairs_out,) = ti.static((world_out.pairs,))
    base = side_block(world_out.grains, r, world_out.replicas.side[r])
    valid = entry_block(pairs_out, r, world_out.replicas.side[r])
    for rank in range(world_out.replicas.released[r]):
        for e in range(pairs_out.start[base + rank], pairs_out.stop[base + rank]):
            f, g = e - valid + source, e - valid + target
            pairs_out.label[g] = pairs_out.label[f]
            pairs_out.tangential_displacement[g] = pairs_out.tangential_displacement[f]
            pairs_out.rolling_displacement[g] = pairs_out.rolling_displacement[f]


@ti.func
def clear(grains_out: ti.template(), place):
    """Empty one place of a force buffer."""
    grains_out.force[place] = 0.0 * grains_out.force[place]
    grains_out.torque[place] = 0.0 * grains_out.torque[place]


@ti.kernel
def sum_pair_forces(
    # parameters
    r: ti.i32,
    # out
    world_out: ti.template(),
    sums_out: ti.types.ndarray(dtype=ti.f64, ndim=1),
):
    """Sum of the forces between grains (3) and of their sizes [N]; contacts are left as they were."""
    grains_out, replicas = ti.static((world_out.grains, world_out.replicas))
    ti.loop_config(serialize=True)
    for _ in range(1):
        valid = entry_block(world_out.pairs, r, replicas.side[r])
        spare = entry_block(world_out.pairs, r, 1 - replicas.side[r])
        copy_memory(world_out, r, valid, spare)
        for p in range(replicas.partitions[r]):
            add_pair_forces(world_out, r, p)
        for p in range(replicas.partitions[r]):
            gather_forces(world_out, r, p)
            first = partition_first(replicas, r, p)
            for rank in range(first, partition_first(replicas, r, p + 1)):
                place = force_block(grains_out, replicas, r, p) + rank
                for k in ti.static(range(3)):
                    sums_out[k] += ti.cast(grains_out.force[place][k], ti.f64)
                sums_out[3] += ti.cast(grains_out.force[place].norm(), ti.f64)
                clear(grains_out, place)
        copy_memory(world_out, r, spare, valid)


def force_imbalance(sim: Simulation, replica: int) -> float:
    """Size of the sum of all forces between grains over the sum of their sizes [1]."""
    sums = np.zeros(4)
    sum_pair_forces(replica, sim.world, sums)
    return float(np.linalg.norm(sums[:3]) / sums[3]) if sums[3] > 0.0 else 0.0


STEPS_MOST = 100_000  # a pair that has not parted by then sticks


@dataclass(frozen=True)
class Impact:
    """One pair of materials and what it gave back."""

    replica: int
    pair: str  # as `contact` names it
    speed: float  # m s-1, before
    stated: float  # coefficient of restitution in the table [1]
    found: float  # speed after over speed before [1], 0 where the pair sticks
    adhesive: bool  # adhesion takes a share of the speed that the table does not state


@dataclass(frozen=True)
class ImpactCase:
    """What the device needs to know of one impact."""

    row: int  # of Materials
    root_radius: float  # m^0.5, square root of the effective radius
    mass: float  # kg, effective
    time_step: float  # s


@ti.kernel
def simulate_impacts(
    # in
    world: ti.template(),
    row: ti.types.ndarray(dtype=ti.i32, ndim=1),
    numbers: ti.types.ndarray(dtype=ti.f64, ndim=2),
    # out
    speed_out: ti.types.ndarray(dtype=ti.f64, ndim=1),
):
    """Replace speeds before by speeds after; columns of `numbers` are those of Blow after its row."""
    ti.loop_config(serialize=True)
    for k in range(row.shape[0]):
        root, mass = ti.cast(numbers[k, 0], float), ti.cast(numbers[k, 1], float)
        dt, closing = ti.cast(numbers[k, 2], float), ti.cast(speed_out[k], float)
        damping = world.materials.damping[row[k]] * ti.sqrt(mass)
        overlap = 0.0 * dt
        step = 0
        while step < STEPS_MOST:
            force, radius, _, acts = world.laws.normal_force(world.materials, row[k], overlap, root, 1)
            if acts == 0 and closing < 0.0:
                step = STEPS_MOST + 1
            else:
                closing -= ti.cast(acts, float) * (force + damping * ti.sqrt(radius) * closing) / mass * dt
                overlap += closing * dt
                step += 1
        speed_out[k] = ti.select(step > STEPS_MOST, -ti.cast(closing, ti.f64), 0.0)


def impact_cases(setup: Setup) -> Iterator[tuple[str, ImpactCase, float, float]]:
    """Name, numbers, stated restitution and surface energy of every pair that can meet.

    The smallest grain strikes: its contacts are the shortest and the hardest to follow.
    """
    smallest = int(np.argmin(setup.grains.radius))
    radius, mass = float(setup.grains.radius[smallest]), float(setup.grains.mass[smallest])
    grain = int(setup.grains.material[smallest])
    walls = sorted({surface.material for surface in setup.surfaces})
    for other, share in [(grain, 0.5), *((wall, 1.0) for wall in walls)]:
        row = pair_row(grain, other, len(setup.materials))
        blow = ImpactCase(row, float(np.sqrt(share * radius)), share * mass, setup.time_step)
        pair = f"{setup.materials[grain]}-{setup.materials[other]}"
        table = setup.contacts
        yield pair, blow, float(table.restitution[row]), float(table.surface_energy[row])


def first_impacts(sim: Simulation, speeds: Sequence[float]) -> list[Impact]:
    """Impacts of all pairs of all replicas, at one speed a replica [m s-1]."""
    known = [(r, *blow) for r, setup in enumerate(sim.setups) for blow in impact_cases(setup)]
    rows = [r * sim.world.materials.rows + blow.row for r, _, blow, _, _ in known]
    numbers = [(blow.root_radius, blow.mass, blow.time_step) for _, _, blow, _, _ in known]
    after = np.array([speeds[r] for r, *_ in known], np.float64)
    simulate_impacts(sim.world, np.array(rows, np.int32), np.array(numbers, np.float64), after)
    return [
        Impact(r, pair, speeds[r], stated, float(speed) / speeds[r], energy > 0.0)
        for (r, pair, _, stated, energy), speed in zip(known, after, strict=True)
    ]
