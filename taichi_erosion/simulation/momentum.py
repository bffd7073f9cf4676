"""Momentum that grains give each other in one step: none, up to rounding.

    sum of F = 0

F is the force between grains as the step gathers it from the buffers of all partitions, so a reaction that
is lost among lists, buffers and workers shows. The memory of the contacts is put aside meanwhile, in the
side of the lists that waits for the next rebuild: the run goes on bit for bit as if nobody had looked.
"""

import numpy as np

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.integrate import gather_forces
from taichi_erosion.grains.pair_contacts import add_pair_forces
from taichi_erosion.grains.pairs import entry_block
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
            pairs_out.slip[g] = pairs_out.slip[f]
            pairs_out.tilt[g] = pairs_out.tilt[f]


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


def momentum_astray(sim: Simulation, replica: int) -> float:
    """Size of the sum of all forces between grains over the sum of their sizes [1]."""
    sums = np.zeros(4)
    sum_pair_forces(replica, sim.world, sums)
    return float(np.linalg.norm(sums[:3]) / sums[3]) if sums[3] > 0.0 else 0.0
