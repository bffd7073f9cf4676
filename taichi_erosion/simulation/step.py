"""Time loop of a replica, on the device for many steps per launch: rebuild, exchange, forces, motion."""

import sys

from taichi_erosion.core.snapshot import Status
from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.exchange import exchange_momentum
from taichi_erosion.grains.cells import GONE, fit_grid_to_grains, sort_grains_by_cell, wrap, wrapped_position
from taichi_erosion.grains.clumps import NOWHERE, advance_clumps, record_sphere_places
from taichi_erosion.grains.integrate import add_partition_buffers, advance_grains, publish_next_action
from taichi_erosion.grains.neighbour_list import count_wide_grains
from taichi_erosion.grains.neighbour_search import copy_grains_in_order, list_partition_pairs, release_grains
from taichi_erosion.grains.pair_contacts import add_pair_forces
from taichi_erosion.grains.partition import balance_partitions, owns_partition, wait_at_barrier, wait_in_step
from taichi_erosion.grains.state import ARRIVAL_SLOT, REBUILD, STOP, side_start
from taichi_erosion.grains.wall_contacts import add_wall_forces, list_walls_of_partition
from taichi_erosion.grains.walls import move_walls

LARGEST = sys.float_info.max
LOST = int(Status.LOST)
NOT_FINITE = int(Status.NOT_FINITE)
OVERLAP = int(Status.OVERLAP)
OVERFLOW = int(Status.OVERFLOW)


@ti.func
def position_fault(world: ti.template(), r, rank):
    """Whether the position of a grain is finite and inside the domain: 0, LOST or NOT_FINITE, and where."""
    grains, replicas = ti.static((world.grains, world.replicas))
    i = side_start(grains, r, replicas.side[r]) + rank
    position = wrapped_position(grains, replicas, r, i)
    if ti.static(world.has_clumps):  # all spheres of a clump leave together
        sphere = r * grains.capacity + grains.ident[i]
        body = r * world.clumps.capacity + world.source.body[sphere]
        position = wrap(world.clumps.position[body], replicas.period[r], replicas.low[r])
    fault, value = 0, ti.cast(0.0, float)
    for k in ti.static(range(3)):
        # not x - x == 0, which Mesa's driver for Vulkan takes to be true for every number
        finite = ti.abs(position[k]) <= ti.f64(LARGEST)
        if not (finite and replicas.low[r][k] <= position[k] <= replicas.high[r][k]):
            fault, value = ti.select(finite, LOST, NOT_FINITE), ti.cast(position[k], float)
    return fault, value


@ti.func
def check_positions(world_out: ti.template(), r):
    """Stop the replica where a position is not finite; a grain outside the domain too, or it is taken out."""
    leaving = 0
    for rank in range(world_out.replicas.released[r]):
        fault, value = position_fault(world_out, r, rank)
        leaves = mark_removal(world_out, r, rank, fault)
        leaving += leaves
        if fault != 0 and leaves == 0:
            stop_at(world_out.replicas, r, rank, fault, value)
    world_out.replicas.leaving[r] = leaving


@ti.func
def mark_removal(world_out: ti.template(), r, rank, fault):
    """Note for the sort whether a grain is to be taken out, which stays in all lists; returns 1 if so."""
    (grains,) = ti.static((world_out.grains,))
    leaves = world_out.replicas.removes[r] * ti.cast(fault == LOST, ti.i32)
    if world_out.replicas.removes[r] == 1:
        world_out.cells.cell[r * grains.capacity + rank] = GONE * leaves
        if ti.static(world_out.has_clumps):
            if leaves == 1:
                i = side_start(grains, r, world_out.replicas.side[r]) + rank
                world_out.clumps.rank[r * grains.capacity + grains.ident[i]] = NOWHERE
    return leaves


@ti.func
def count_removed(replicas_out: ti.template(), r, number):
    """Count so many grains as taken out of replica r, which are those of the last ranks."""
    released = replicas_out.released[r] - number
    replicas_out.released[r] = released
    replicas_out.removed[r] = replicas_out.removed[r] + number
    replicas_out.bounds[r, replicas_out.partitions[r]] = released


@ti.func
def stop_at(replicas_out: ti.template(), r, rank, fault, value):
    replicas_out.status[r] = fault
    replicas_out.fault_grain[r, 0] = rank
    replicas_out.fault_value[r, 0] = value


@ti.func
def prepare_rebuild(world_out: ti.template(), r):
    """Single-worker part of a rebuild: release, check, sort, balance the partitions."""
    release_grains(world_out, r)
    check_positions(world_out, r)
    if world_out.replicas.status[r] == 0:
        count_wide_grains(world_out, r)
        if ti.static(not world_out.has_external_forces):
            fit_grid_to_grains(world_out.cells, world_out.grains, world_out.replicas, r)
        sort_grains_by_cell(world_out.cells, world_out.grains, world_out.replicas, r)
        count_removed(world_out.replicas, r, world_out.replicas.leaving[r])
        balance_partitions(world_out, r)


@ti.func
def finish_rebuild(world_out: ti.template(), r):
    """Make the other side the valid one; where the lists did not fit, keep the old and stop."""
    swap_sides(world_out.replicas, r)
    if ti.static(world_out.has_clumps):
        if world_out.replicas.status[r] == 0:
            record_sphere_places(world_out, r, 0, world_out.replicas.released[r])


@ti.func
def swap_sides(replicas_out: ti.template(), r):
    """Make the other side of replica r the valid one, unless lists did not fit."""
    short = 0
    for p in range(replicas_out.partitions[r]):
        short += replicas_out.short[r, p] + replicas_out.wall_short[r, p]
    if short > 0:
        replicas_out.status[r] = OVERFLOW
        count_removed(replicas_out, r, -replicas_out.leaving[r])
    else:
        replicas_out.side[r] = 1 - replicas_out.side[r]
        replicas_out.rebuilds[r] = replicas_out.rebuilds[r] + 1
        replicas_out.wall_travel[r] = 0.0
        replicas_out.stale[r] = 0


@ti.func
def list_neighbours_of_partition(world_out: ti.template(), r, p):
    list_partition_pairs(world_out, r, p)
    list_walls_of_partition(world_out, r, p)


@ti.func
def add_partition_forces(world_out: ti.template(), r, p):
    """Forces of one partition, while its grains are in the cache."""
    add_pair_forces(world_out, r, p)
    add_wall_forces(world_out, r, p)


@ti.func
def apply_to_own_partitions(task: ti.template(), world_out: ti.template(), r, member, size):
    """One device function applied to every partition that a member of the team owns."""
    for p in range(world_out.replicas.partitions[r]):
        if owns_partition(world_out.replicas, r, p, member, size):
            task(world_out, r, p)


@ti.func
def sort_and_rebuild_lists(world_out: ti.template(), r, member, size, phase):
    """Sort the grains and rebuild all lists; returns the next barrier."""
    # no worker may change what another still reads to decide on this rebuild
    phase = wait_at_barrier(world_out.replicas, r, size, phase)
    if member == 0:
        prepare_rebuild(world_out, r)
    phase = wait_at_barrier(world_out.replicas, r, size, phase)
    if world_out.replicas.status[r] == 0:
        apply_to_own_partitions(copy_grains_in_order, world_out, r, member, size)
        phase = wait_at_barrier(world_out.replicas, r, size, phase)
        apply_to_own_partitions(list_neighbours_of_partition, world_out, r, member, size)
        phase = wait_at_barrier(world_out.replicas, r, size, phase)
        if member == 0:
            finish_rebuild(world_out, r)
        phase = wait_at_barrier(world_out.replicas, r, size, phase)
    return phase


@ti.func
def required_action(world: ti.template(), r):
    """Action before the next step: none, REBUILD or STOP; all members of a team read the same."""
    replicas, source = ti.static((world.replicas, world.source))
    action = replicas.stale[r]
    for p in range(replicas.partitions[r]):
        action = ti.max(action, replicas.need[r, p])
    ident = replicas.released[r] + replicas.removed[r]
    if ident < replicas.total[r]:
        if source.release_step[r * world.grains.capacity + ident] <= replicas.step[r]:
            action = ti.max(action, REBUILD)
    if replicas.wall_travel[r] > replicas.skin_most[r]:
        action = ti.max(action, REBUILD)
    return action


@ti.func
def integrate_partitions(world_out: ti.template(), r, member, size, step, is_last):
    for p in range(world_out.replicas.partitions[r]):
        if owns_partition(world_out.replicas, r, p, member, size):
            need = 0
            if ti.static(world_out.has_clumps):
                need = advance_clumps(world_out, r, p, step)
            else:
                add_partition_buffers(world_out, r, p)
                need = advance_grains(world_out, r, p, step, is_last)
            publish_next_action(world_out.replicas, r, p, need)


@ti.func
def advance_clock_and_walls(world_out: ti.template(), r):
    """Advance walls and clock by one step; where a worker was late, the launch ends after the next one."""
    (replicas_out,) = ti.static((world_out.replicas,))
    move_walls(world_out.walls, replicas_out, r)
    replicas_out.step[r] = replicas_out.step[r] + 1
    replicas_out.pause[r] = replicas_out.late[r]


@ti.func
def step_replica(world_out: ti.template(), coupling_out: ti.template(), r, member, size, phase, is_last):
    """Advance one replica by one time step; returns the next barrier."""
    (replicas_out,) = ti.static((world_out.replicas,))
    step = replicas_out.step[r]
    if ti.static((world_out.has_external_forces or world_out.has_state) and not coupling_out.host_driven):
        if step % coupling_out.exchange.look_steps[r] == 0:
            phase = exchange_momentum(world_out, coupling_out, r, member, size, phase)
    apply_to_own_partitions(add_partition_forces, world_out, r, member, size)
    phase = wait_in_step(replicas_out, r, size, phase)
    integrate_partitions(world_out, r, member, size, step, is_last)
    if member == 0:
        advance_clock_and_walls(world_out, r)
    return wait_in_step(replicas_out, r, size, phase)


@ti.func
def advance_replica(world_out: ti.template(), coupling_out: ti.template(), r, member, size, steps):
    """Time loop of one replica until its steps are done, it needs the host, it pauses, or it fails."""
    (replicas_out,) = ti.static((world_out.replicas,))
    phase = 1
    count = 0
    going = replicas_out.status[r] == 0
    while going and count < steps:
        action = required_action(world_out, r)
        if action == REBUILD:
            phase = sort_and_rebuild_lists(world_out, r, member, size, phase)
        going = action != STOP and replicas_out.status[r] == 0
        if going:
            paused = replicas_out.pause[r] == 1
            is_last = count == steps - 1 or paused
            phase = step_replica(world_out, coupling_out, r, member, size, phase, is_last)
            count += 1
            going = not paused
    if member == 0:
        finish_replica_launch(replicas_out, r, count)


@ti.func
def finish_replica_launch(replicas_out: ti.template(), r, done):
    """Count the steps done; an overlap found by any partition becomes the status of the replica."""
    replicas_out.steps_left[r] = replicas_out.steps_left[r] - done
    for p in range(replicas_out.partitions[r]):
        if replicas_out.need[r, p] == STOP:
            replicas_out.status[r] = OVERLAP


@ti.func
def run_worker_tasks(world_out: ti.template(), coupling_out: ti.template(), schedule: ti.template(), worker):
    """Run the tasks of one worker in order, each after the earlier tasks of its replica."""
    for task in range(schedule.first[worker], schedule.first[worker + 1]):
        r = schedule.replica[task]
        while ti.atomic_add(world_out.replicas.arrivals[r, ARRIVAL_SLOT], 0) < schedule.order[task]:
            pass
        advance_replica(world_out, coupling_out, r, 0, 1, schedule.steps[task])
        ti.atomic_add(world_out.replicas.arrivals[r, ARRIVAL_SLOT], 1)


@ti.kernel
def release_grains_before_start(world_out: ti.template()):
    """Release the grains that are there from the start, so that a state can be read before the first step."""
    for r in range(world_out.replicas.count):
        release_grains(world_out, r)


@ti.kernel
def run_scheduled_replicas(
    workers: ti.i32,
    chunk: ti.i32,
    schedule: ti.template(),
    world_out: ti.template(),
    coupling_out: ti.template(),
):
    """Each worker advances whole replicas by itself, in the order of the schedule."""
    for lane in range(workers * chunk):
        if lane % chunk == 0:
            run_worker_tasks(world_out, coupling_out, schedule, lane // chunk)


@ti.kernel
def run_replicas_in_teams(
    teams: ti.i32, size: ti.i32, chunk: ti.i32, world_out: ti.template(), coupling_out: ti.template()
):
    """Teams of `size` workers divide the partitions of one replica each."""
    for lane in range(teams * size * chunk):
        if lane % chunk == 0:
            worker = lane // chunk
            r = worker // size
            steps = world_out.replicas.steps_left[r]
            advance_replica(world_out, coupling_out, r, worker % size, size, steps)
