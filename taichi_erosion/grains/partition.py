"""Partition: how the grains of a replica are divided among worker threads, and the barrier between them.

On a CPU one task is one worker thread. Where there are two workers or more for every replica, they form a
team that divides its partitions; elsewhere a worker advances whole replicas, in the order of the schedule.
Partitions and their order of summation are properties of the replica, so the result is the same.

The partitions of a replica take about equally long: the cost of a grain is that of its motion, its listed
pairs and its contacts before the rebuild. Costs are counted, not timed: the bounds must be the same in every
run, since forces are summed partition by partition.
"""

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.neighbour_list import ENGAGED
from taichi_erosion.grains.state import ARRIVAL_SLOT, side_start

CPU_CHUNK = 512  # Taichi divides CPU iterations into blocks of this size: one worker needs a whole block
# costs over that of testing a listed pair that is apart; measured in a funnel that empties
GRAIN = 2  # motion and a share of the rebuild
CONTACT = 3  # of a pair that touches, beyond that
WALL = 4  # of a wall in the list
WALL_CONTACT = 12  # of a wall that is touched, beyond that


@ti.func
def wait_at_barrier(replicas_out: ti.template(), r, size, phase):
    """Wait until all `size` workers of a team have arrived; returns the number of the next barrier."""
    if size > 1:
        ti.atomic_add(replicas_out.arrivals[r, ARRIVAL_SLOT], 1)
        # an atomic read: a plain one may be hoisted out of the loop
        while ti.atomic_add(replicas_out.arrivals[r, ARRIVAL_SLOT], 0) < phase * size:
            pass
    return phase + 1


@ti.func
def wait_in_step(replicas_out: ti.template(), r, size, phase):
    """Barrier between parts of a step, which take all workers equally long; notes whether one was late."""
    if size > 1:
        ti.atomic_add(replicas_out.arrivals[r, ARRIVAL_SLOT], 1)
        spins = 0
        while ti.atomic_add(replicas_out.arrivals[r, ARRIVAL_SLOT], 0) < phase * size:
            spins += 1
        if spins > replicas_out.spins_most[r]:
            replicas_out.late[r] = 1
    return phase + 1


@ti.func
def owns_partition(replicas: ti.template(), r, p, member, size):
    """Whether partition p belongs to a member of the team; members own runs of neighbouring partitions."""
    return p * size // replicas.partitions[r] == member


@ti.func
def engaged_contacts(entries: ti.template(), i):
    number = 0
    for e in range(entries.start[i], entries.stop[i]):
        number += entries.label[e] & ENGAGED
    return number


@ti.func
def grain_cost(world: ti.template(), i):
    """Cost of the grain at place i, from its lists before the rebuild."""
    pairs, walls = ti.static((world.pairs, world.wall_pairs))
    listed = pairs.stop[i] - pairs.start[i] + WALL * (walls.stop[i] - walls.start[i])
    return GRAIN + listed + CONTACT * engaged_contacts(pairs, i) + WALL_CONTACT * engaged_contacts(walls, i)


@ti.func
def balance_partitions(world_out: ti.template(), r):
    """Bounds of all partitions of replica r in the new order, by one worker."""
    grains, cells, replicas_out = ti.static((world_out.grains, world_out.cells, world_out.replicas))
    base = side_start(grains, r, replicas_out.side[r])
    count, parts = replicas_out.released[r], replicas_out.partitions[r]
    whole = ti.cast(0, ti.i64)
    if parts > 1:
        for i in range(base, base + count):
            whole += grain_cost(world_out, i)
    number = 1
    spent = ti.cast(0, ti.i64)
    for rank in range(count * ti.cast(parts > 1, ti.i32)):
        while number < parts and spent * parts >= whole * number:
            replicas_out.bounds[r, number] = rank
            number += 1
        spent += grain_cost(world_out, base + cells.order[r * grains.capacity + rank])
    for p in range(number, parts):
        replicas_out.bounds[r, p] = count
