"""One step of all replicas by the grain decomposition, and the launch of many."""

from collections.abc import Iterator
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import field_view, is_host
from taichi_erosion.coupling.coupling_state import CouplingState
from taichi_erosion.grains import World
from taichi_erosion.grains.clumps import advance_clump, released_bodies
from taichi_erosion.grains.state import REBUILD, STOP
from taichi_erosion.simulation.grain_decomposition.buffers import NO_FAULT, GrainBuffers, Stages
from taichi_erosion.simulation.grain_decomposition.exchange import exchange_stages, first_exchange_stages
from taichi_erosion.simulation.grain_decomposition.forces import add_walls, evaluate_entry, move, sum_pairs
from taichi_erosion.simulation.grain_decomposition.rebuild import link_stages, rebuild_stages
from taichi_erosion.simulation.step import OVERLAP, required_action, tick

MISSING_FUNCTION = ("does not 64bits operation", "must <= 32bits")  # of Taichi's compiler for Vulkan
LAUNCH_MOST = 1 << 22  # threads of a launch: Vulkan devices need not start more than 65,535 groups of 128
THREADS_MOST = 1 << 18  # of a stage of queued replicas: they are few, and each thread takes some places
STEPS_A_REBUILD = 4  # steps between two launches that look for rebuilds; a replica waits for the next one


@ti.func
def judge(world_out: ti.template(), buffers_out: ti.template(), r):
    """Whether replica r takes part in the coming step; a replica with too large an overlap is stopped."""
    (replicas_out,) = ti.static((world_out.replicas,))
    stepping = 0
    if replicas_out.status[r] == 0:
        action = required_action(world_out, r)
        if action == STOP:
            replicas_out.status[r] = OVERLAP
        elif action != REBUILD and replicas_out.steps_left[r] > 0:
            stepping = buffers_out.linked[r]
    buffers_out.stepping[r] = stepping


@ti.func
def note_fault(world_out: ti.template(), buffers_out: ti.template(), r):
    """Record the first overlap beyond the limit of this step, in the order of the list entries."""
    replicas_out, pairs = ti.static((world_out.replicas, world_out.pairs))
    k = buffers_out.faulty[r]
    if k != NO_FAULT:
        if k < pairs.capacity:
            e = (2 * r + replicas_out.side[r]) * pairs.capacity + k
            replicas_out.fault_grain[r, 0] = pairs.owner[e]
            replicas_out.fault_partner[r, 0] = pairs.neighbour[e]
            replicas_out.fault_value[r, 0] = buffers_out.level[r * pairs.capacity + k] - 1.0
        else:
            place = r * world_out.grains.capacity + k - pairs.capacity
            replicas_out.fault_grain[r, 0] = k - pairs.capacity
            replicas_out.fault_partner[r, 0] = buffers_out.wall[place]
            replicas_out.fault_value[r, 0] = buffers_out.wall_overlap[place]
        replicas_out.need[r, 0] = STOP
        buffers_out.faulty[r] = NO_FAULT


@ti.func
def is_stepping(world: ti.template(), coupling: ti.template(), buffers: ti.template(), r):
    """Whether the coming step advances replica r."""
    return buffers.stepping[r] == 1


@ti.func
def evaluate(world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, k):
    """Force of one pair."""
    if k < buffers_out.listed[r]:
        evaluate_entry(world_out, buffers_out, r, k)


@ti.func
def integrate_grain(world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, rank):
    """Forces on one grain, and its motion; a sphere of a clump moves with its body."""
    if rank < world_out.replicas.released[r]:
        sum_pairs(world_out, buffers_out, r, rank)
        add_walls(world_out, buffers_out, r, rank)
        if ti.static(not world_out.clumped):
            move(world_out, r, rank)


@ti.func
def integrate_body(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, k):
    """Motion of one clump: the forces on its spheres are summed in their order."""
    if k < released_bodies(world_out, r):
        need = advance_clump(world_out, r, k, world_out.replicas.step[r])
        if need != 0:
            ti.atomic_max(world_out.replicas.need[r, 0], need)


@ti.func
def end_step(world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, _):
    """Clock, walls and faults of replica r, and whether it goes on."""
    note_fault(world_out, buffers_out, r)
    tick(world_out, r)
    world_out.replicas.steps_left[r] = world_out.replicas.steps_left[r] - 1
    judge(world_out, buffers_out, r)


def step_stages(world: World, coupling: CouplingState) -> Stages:
    """Stages of one step."""
    tasks = [(evaluate, world.pairs.capacity), (integrate_grain, world.grains.capacity)]
    if world.clumped:
        tasks.append((integrate_body, world.clumps.capacity))
    steps = ((is_stepping, task, width) for task, width in [*tasks, (end_step, 1)])
    return (*exchange_stages(world, coupling), *steps)


@ti.kernel
def run_queued(
    # parameters
    stages: ti.template(),
    # out
    world_out: ti.template(),
    buffers_out: ti.template(),
):
    """Run stages one after the other, each for all queued replicas at once; it writes what they write."""
    for stage in ti.static(stages):
        task, width = ti.static(stage)
        threads = ti.static(min(world_out.replicas.count * width, THREADS_MOST))
        for thread in range(threads):
            n = thread
            while n < buffers_out.queued[0] * width:
                task(world_out, buffers_out, buffers_out.queue[n // width], n % width)
                n += threads


@ti.kernel
def run_part(
    # parameters
    stages: ti.template(),
    first: ti.i32,
    # out
    world_out: ti.template(),
    coupling_out: ti.template(),
    buffers_out: ti.template(),
):
    """Run stages one after the other, from thread `first` on; it writes what they write."""
    for stage in ti.static(stages):
        acts, task, width = ti.static(stage)
        wanted = ti.static(world_out.replicas.count * width)
        for thread in range(ti.static(min(wanted, LAUNCH_MOST))):
            n = first + thread
            if n < wanted:
                if acts(world_out, coupling_out, buffers_out, n // width):
                    task(world_out, coupling_out, buffers_out, n // width, n % width)


def launches(stages: Stages, replicas: int) -> Iterator[tuple[Stages, int]]:
    """Launches of stages of so many replicas, with their first threads.

    One, or several for each stage where one of them has more threads than a device need start at once.
    """
    if all(replicas * width <= LAUNCH_MOST for *_, width in stages):
        yield stages, 0
        return
    for stage in stages:
        for first in range(0, replicas * stage[-1], LAUNCH_MOST):
            yield (stage,), first


def run_all(stages: Stages, world: World, coupling: CouplingState, buffers: GrainBuffers) -> None:
    """Run stages one after the other, each for all replicas at once."""
    for part, first in launches(stages, world.replicas.count):
        run_part(part, first, world, coupling, buffers)


@ti.func
def needs_lists(world: ti.template(), r):
    """Whether replica r has steps to do and needs new neighbour lists."""
    needs = world.replicas.status[r] == 0 and world.replicas.steps_left[r] > 0
    return needs and required_action(world, r) == REBUILD


@ti.func
def needs_links(world: ti.template(), buffers: ti.template(), r):
    """Whether replica r has no reverse lists."""
    return world.replicas.status[r] == 0 and buffers.linked[r] == 0


@ti.kernel
def queue_replicas(
    # parameters
    for_lists: ti.template(),
    # in
    world: ti.template(),
    # out
    buffers_out: ti.template(),
):
    """Queue the replicas that need new neighbour lists, or those that have no reverse lists.

    Writes `buffers_out`: queue, queued.
    """
    for _ in range(1):
        buffers_out.queued[0] = 0
    for r in range(world.replicas.count):
        wanted = needs_lists(world, r) if ti.static(for_lists) else needs_links(world, buffers_out, r)
        if wanted:
            # the place in the queue changes no result
            buffers_out.queue[ti.atomic_add(buffers_out.queued[0], 1)] = r


@ti.kernel
def judge_all(
    # out
    world_out: ti.template(),
    buffers_out: ti.template(),
):
    """Which replicas take part in the coming step.

    Writes `buffers_out`: stepping.
    Writes `world_out`: replicas.status.
    """
    for r in range(world_out.replicas.count):
        judge(world_out, buffers_out, r)


def run_steps(world: World, coupling: CouplingState, buffers: GrainBuffers, steps: int) -> None:
    """Launch so many steps; a replica that waited for new lists has done fewer.

    Nothing is read back in between, except on a CPU, where fields are read in place: there the launches that
    look for rebuilds are left out while no replica waits. Raises BadInput where Vulkan lacks a function.
    """
    stages, first = step_stages(world, coupling), first_exchange_stages(world, coupling)
    try:
        renew_lists(world, buffers)
        if first:
            run_all(first, world, coupling, buffers)
        for k in range(1, steps + 1):
            run_all(stages, world, coupling, buffers)
            if is_waiting(world, buffers) if is_host() else k % STEPS_A_REBUILD == 0:
                renew_lists(world, buffers)
        ti.sync()
    except RuntimeError as error:
        if any(words in str(error) for words in MISSING_FUNCTION):
            raise BadInput(
                "--arch vulkan: a law or an effect of this scene needs a power, an exponential or a "
                "sine of 64-bit floats, which Vulkan lacks; use --precision f32 or --arch cpu"
            ) from None
        raise


def renew_lists(world: World, buffers: GrainBuffers) -> None:
    """Rebuild the lists of the replicas that need it."""
    queue_replicas(True, world, buffers)
    for stages in rebuild_stages(world, buffers):
        run_queued(stages, world, buffers)
    queue_replicas(False, world, buffers)
    run_queued(link_stages(world, buffers), world, buffers)
    judge_all(world, buffers)


def is_waiting(world: World, buffers: GrainBuffers) -> bool:
    """Whether any replica has steps to do and does not take part, on a CPU."""
    replicas = world.replicas
    running: Any = (field_view(replicas.status) == 0) & (field_view(replicas.steps_left) > 0)
    return bool((running & (field_view(buffers.stepping) == 0)).any())
