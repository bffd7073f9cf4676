"""Self-checks of a run: momentum balance of the pair forces, and first impacts of every pair of materials.

Momentum: the sum of the forces between grains is zero to rounding. The forces are summed from the buffers of
all partitions as in a step, so a reaction that is lost among lists, buffers and workers shows. The contact
histories are copied meanwhile to the side of the lists that is free until the next rebuild: the run goes on
bit for bit.

First impact: two grains, or a grain and a wall, collide head-on at a stated speed, with the contact laws,
tables and time step of the run; the rebound speed is compared with the stated restitution.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from taichi_erosion.core.setup import Setup, pair_row
from taichi_erosion.core.ti import ti
from taichi_erosion.grains.integrate import gather_forces
from taichi_erosion.grains.materials import device_rows
from taichi_erosion.grains.neighbour_list import entry_block
from taichi_erosion.grains.pair_contacts import add_pair_forces
from taichi_erosion.grains.state import force_block, partition_first, side_block
from taichi_erosion.simulation.assemble import Simulation
from taichi_erosion.simulation.grain_decomposition.forces import evaluate_entry, sum_pairs
from taichi_erosion.simulation.grain_decomposition.step import renew_lists


@ti.func
def copy_histories(world_out: ti.template(), r, source, target):
    """Copy the contact histories from one side of the lists to the other, entry by entry."""
    (pairs_out,) = ti.static((world_out.pairs,))
    base = side_block(world_out.grains, r, world_out.replicas.side[r])
    valid = entry_block(pairs_out, r, world_out.replicas.side[r])
    for rank in range(world_out.replicas.released[r]):
        for e in range(pairs_out.start[base + rank], pairs_out.stop[base + rank]):
            copy_entry(pairs_out, e - valid + source, e - valid + target)


@ti.func
def copy_entry(pairs_out: ti.template(), source, target):
    """Copy the history of one entry."""
    pairs_out.label[target] = pairs_out.label[source]
    pairs_out.tangential_displacement[target] = pairs_out.tangential_displacement[source]
    pairs_out.rolling_displacement[target] = pairs_out.rolling_displacement[source]


@ti.func
def clear(grains_out: ti.template(), place):
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
    """Sum of the forces between grains (3) and of their magnitudes [N]; contacts are left as they were.

    Writes `world_out`: grains.force, grains.torque, pairs.label, pairs.rolling_displacement,
    pairs.tangential_displacement, replicas.fault_grain, replicas.fault_partner, replicas.fault_value,
    sleep.state.
    """
    grains_out, replicas = ti.static((world_out.grains, world_out.replicas))
    ti.loop_config(serialize=True)
    for _ in range(1):
        valid = entry_block(world_out.pairs, r, replicas.side[r])
        spare = entry_block(world_out.pairs, r, 1 - replicas.side[r])
        copy_histories(world_out, r, valid, spare)
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
        copy_histories(world_out, r, spare, valid)


@ti.kernel
def keep_pair_forces(
    # parameters
    r: ti.i32,
    # out
    world_out: ti.template(),
    buffers_out: ti.template(),
    force_out: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """Force of all pairs on every grain by rank [N], one thread per pair and grain; contacts stay the same.

    Writes `buffers_out`: back, faulty, force, level, torque.
    Writes `world_out`: grains.force, grains.torque, pairs.label, pairs.rolling_displacement,
    pairs.tangential_displacement, sleep.state.
    """
    side = world_out.replicas.side[r]
    valid, spare = entry_block(world_out.pairs, r, side), entry_block(world_out.pairs, r, 1 - side)
    for k in range(buffers_out.listed[r]):
        copy_entry(world_out.pairs, valid + k, spare + k)
        evaluate_entry(world_out, buffers_out, r, k)
    for rank in range(world_out.grains.capacity):
        if rank < world_out.replicas.released[r]:
            sum_pairs(world_out, buffers_out, r, rank)
            place = force_block(world_out.grains, world_out.replicas, r, 0) + rank
            for n in ti.static(range(3)):
                force_out[rank, n] = ti.cast(world_out.grains.force[place][n], ti.f64)
            clear(world_out.grains, place)
    for k in range(buffers_out.listed[r]):
        copy_entry(world_out.pairs, spare + k, valid + k)


def force_imbalance(sim: Simulation, replica: int) -> float:
    """Magnitude of the sum of all forces between grains over the sum of their magnitudes [1]."""
    sums = np.zeros(4)
    if sim.buffers is None:
        sum_pair_forces(replica, sim.world, sums)
    else:
        renew_lists(sim.world, sim.buffers)
        force = np.zeros((sim.capacities.grains, 3))
        keep_pair_forces(replica, sim.world, sim.buffers, force)
        sums[:3], sums[3] = force.sum(axis=0), np.linalg.norm(force, axis=1).sum()
    return float(np.linalg.norm(sums[:3]) / sums[3]) if sums[3] > 0.0 else 0.0


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
