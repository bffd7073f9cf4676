"""Time loop of the grain decomposition: all threads go from stage to stage together, for many steps."""

from functools import lru_cache

from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record
from taichi_erosion.coupling.coupling_state import CouplingState
from taichi_erosion.grains import World
from taichi_erosion.grains.state import ARRIVAL_SLOT, REBUILD, STOP
from taichi_erosion.simulation.grain_decomposition.buffers import NO_FAULT, GrainBuffers, Stage, barrier
from taichi_erosion.simulation.grain_decomposition.exchange import exchange_stages, is_exchange_due
from taichi_erosion.simulation.grain_decomposition.forces import (
    evaluate_pair_at,
    evaluate_wall_forces,
    move_body,
    move_grain,
    sum_all_forces,
)
from taichi_erosion.simulation.grain_decomposition.rebuild import rebuild_stages
from taichi_erosion.simulation.step import OVERLAP, advance_clock_and_walls, required_action

APART_LEAST = 4_000_000  # places of list entries from which on tasks run apart: docs/speed.md
WAIT = 4  # steps between two looks at the lists of several replicas: one that waits lets the others go on


@device_record
class Stages:
    """Stages of a step, and of what is due between steps."""

    decision: Stage
    rebuild: tuple[Stage, ...]
    exchange: tuple[Stage, ...]
    forces: Stage
    motion: tuple[Stage, ...]
    wait: int  # steps between two looks
    look_and_steps: tuple[Stage, ...]  # of a look and `WAIT` steps


@ti.func
def is_always_due(world: ti.template(), coupling: ti.template(), buffers: ti.template(), r):
    """For a task that acts on every replica."""
    return True


@ti.func
def decide_action(world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, _):
    """What replica r needs before its next step: new lists, an exchange, nothing, or its end."""
    (replicas_out,) = ti.static((world_out.replicas,))
    stepping, renewing = 0, 0
    buffers_out.faulty[r] = NO_FAULT
    if replicas_out.status[r] == 0:
        action = required_action(world_out, r)
        if action == STOP:
            replicas_out.status[r] = OVERLAP
        elif replicas_out.steps_left[r] > 0:
            stepping = 1
            ti.atomic_add(buffers_out.running[0], 1)
            if action == REBUILD:
                renewing, buffers_out.listing[0], buffers_out.lost[r] = 1, 1, 0
                replicas_out.bounds[r, 1], replicas_out.leaving[r] = replicas_out.released[r], 0
    buffers_out.stepping[r], buffers_out.renewing[r] = stepping, renewing
    if is_exchanging(world_out, coupling, buffers_out, r):
        buffers_out.exchanging[0] = 1


@ti.func
def clear_action_flags(buffers_out: ti.template()):
    """Clear what the next `decide_action` sets for all replicas together."""
    buffers_out.listing[0], buffers_out.exchanging[0], buffers_out.running[0] = 0, 0, 0


@ti.func
def is_exchanging(world: ti.template(), coupling: ti.template(), buffers: ti.template(), r):
    """Whether replica r exchanges with air, fields or states before the coming step."""
    exchanges = False
    if ti.static((world.has_external_forces or world.has_state) and not coupling.host_driven):
        exchanges = is_exchange_due(world, coupling, buffers, r)
    return exchanges


@ti.func
def is_stepping(world: ti.template(), coupling: ti.template(), buffers: ti.template(), r):
    """Whether the coming step advances replica r: it needs nothing before."""
    return buffers.stepping[r] == 1 and world.replicas.need[r, 0] == 0


@ti.func
def is_moving(world: ti.template(), coupling: ti.template(), buffers: ti.template(), r):
    """Whether this step advances replica r."""
    return buffers.moving[r] == 1


@ti.func
def note_step_changes(world: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, _):
    """Note for the stage of motion what the end of the step changes."""
    buffers_out.moving[r] = ti.cast(is_stepping(world, coupling, buffers_out, r), ti.i32)
    buffers_out.step[r] = world.replicas.step[r]
    buffers_out.last[r] = ti.cast(world.replicas.steps_left[r] == 1, ti.i32)


@ti.func
def record_overlap_fault(world_out: ti.template(), buffers_out: ti.template(), r):
    """Record the first overlap beyond the limit of this step, in the order of the grains, pairs first."""
    (replicas_out,) = ti.static((world_out.replicas,))
    order, grains = buffers_out.faulty[r], world_out.grains.capacity
    if order != NO_FAULT:
        rank = order % grains
        replicas_out.fault_grain[r, 0] = rank
        replicas_out.fault_partner[r, 0] = buffers_out.partner[r * grains + rank]
        replicas_out.fault_value[r, 0] = buffers_out.overlap[r * grains + rank]
        ti.atomic_max(replicas_out.need[r, 0], STOP)
        buffers_out.faulty[r] = NO_FAULT


@ti.func
def end_step(world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, _):
    """Clock, walls and faults of replica r, and whether it waits for a look."""
    (replicas_out,) = ti.static((world_out.replicas,))
    record_overlap_fault(world_out, buffers_out, r)
    advance_clock_and_walls(world_out, r)
    replicas_out.steps_left[r] = replicas_out.steps_left[r] - 1
    waits = replicas_out.steps_left[r] == 0 or required_action(world_out, r) != 0
    if waits or is_exchanging(world_out, coupling, buffers_out, r):
        buffers_out.stepping[r] = 0
        buffers_out.pending[0] = 1


@lru_cache(maxsize=1)
def compile_stages(world: World, coupling: CouplingState, buffers: GrainBuffers) -> Stages:
    """Stages of an ensemble; the same object for the same fields, since a kernel is compiled for it."""
    grains = world.grains.capacity
    forces = ((is_stepping, evaluate_pair_at, world.pairs.capacity), (is_always_due, note_step_changes, 1))
    if world.walls.primitives:
        forces = (*forces, (is_stepping, evaluate_wall_forces, grains))
    motion: tuple[Stage, ...] = (((is_moving, move_grain, grains), (is_moving, end_step, 1)),)
    if world.has_clumps:
        bodies = (is_moving, move_body, world.clumps.capacity), (is_moving, end_step, 1)
        motion = ((is_moving, sum_all_forces, grains),), bodies
    wait = min(WAIT, world.replicas.count)
    rebuild, exchange = rebuild_stages(world, buffers), exchange_stages(world, coupling)
    look = ((is_always_due, decide_action, 1),)
    look_and_steps = (look, *rebuild, *exchange, *(WAIT * (forces, *motion)))
    return Stages(look, rebuild, exchange, forces, motion, wait, look_and_steps)


@ti.func
def run_stage(
    stage: ti.template(),
    world_out: ti.template(),
    coupling_out: ti.template(),
    buffers_out: ti.template(),
    thread,
    phase,
):
    """One stage of all replicas; returns the next barrier."""
    for part in ti.static(stage):
        acts, task, width = ti.static(part)
        n = thread
        while n < world_out.replicas.count * width:
            if acts(world_out, coupling_out, buffers_out, n // width):
                task(world_out, coupling_out, buffers_out, n // width, n % width)
            n += buffers_out.blocks * buffers_out.block
    return barrier(buffers_out, thread, phase)


@ti.func
def renew_and_exchange(
    stages: ti.template(),
    world_out: ti.template(),
    coupling_out: ti.template(),
    buffers_out: ti.template(),
    thread,
    phase,
):
    """What is due between two steps: lists and exchanges; returns the next barrier."""
    phase = run_stage(stages.decision, world_out, coupling_out, buffers_out, thread, phase)
    if buffers_out.listing[0] > 0:
        for stage in ti.static(stages.rebuild):
            phase = run_stage(stage, world_out, coupling_out, buffers_out, thread, phase)
    if buffers_out.exchanging[0] > 0:
        for stage in ti.static(stages.exchange):
            phase = run_stage(stage, world_out, coupling_out, buffers_out, thread, phase)
    return phase


@ti.func
def advance_with_barriers(
    stages: ti.template(),
    world_out: ti.template(),
    coupling_out: ti.template(),
    buffers_out: ti.template(),
    thread,
):
    """Time loop of one thread: every thread takes the same way through it, by flags read behind a barrier.

    A flag is cleared in the stage after the next barrier: until then some thread may still read it.
    """
    phase, steps, looks, going = 1, 0, True, True
    while going:
        if looks:
            phase = renew_and_exchange(stages, world_out, coupling_out, buffers_out, thread, phase)
            going = buffers_out.running[0] > 0
        if going:
            if looks and thread == 0:
                buffers_out.pending[0] = 0
            phase = run_stage(stages.forces, world_out, coupling_out, buffers_out, thread, phase)
            if thread == 0:
                clear_action_flags(buffers_out)
            for stage in ti.static(stages.motion):
                phase = run_stage(stage, world_out, coupling_out, buffers_out, thread, phase)
            steps += 1
            looks = buffers_out.pending[0] == 1 and steps % stages.wait == 0


@ti.kernel
def run_steps_in_one_kernel(
    stages: ti.template(), world_out: ti.template(), coupling_out: ti.template(), buffers_out: ti.template()
):
    """Advance all replicas until none has steps left."""
    for _ in range(1):
        buffers_out.arrivals[ARRIVAL_SLOT] = 0
        clear_action_flags(buffers_out)
    ti.loop_config(block_dim=buffers_out.block * buffers_out.lanes)
    for lane in range(buffers_out.blocks * buffers_out.block * buffers_out.lanes):
        if lane % buffers_out.lanes == 0:
            advance_with_barriers(stages, world_out, coupling_out, buffers_out, lane // buffers_out.lanes)


@ti.kernel
def run_steps_task_by_task(
    stages: ti.template(), world_out: ti.template(), coupling_out: ti.template(), buffers_out: ti.template()
):
    """Look at the lists and advance by `WAIT` steps, task by task, with a thread for each place of a task."""
    for stage in ti.static(stages.look_and_steps):
        for part in ti.static(stage):
            acts, task, width = ti.static(part)
            for n in range(world_out.replicas.count * width):
                if acts(world_out, coupling_out, buffers_out, n // width):
                    task(world_out, coupling_out, buffers_out, n // width, n % width)


def run_steps(world: World, coupling: CouplingState, buffers: GrainBuffers, steps: int) -> None:
    """Launch so many steps; a replica that waited for new lists has done fewer where tasks run apart.

    Threads that stay and wait for each other save launches; very many grains are faster by tasks, whose
    blocks need not fit all at once.
    """
    stages, places = compile_stages(world, coupling, buffers), world.replicas.count * world.pairs.capacity
    if places < APART_LEAST:
        run_steps_in_one_kernel(stages, world, coupling, buffers)
    else:
        for _ in range(-(-steps // WAIT)):
            run_steps_task_by_task(stages, world, coupling, buffers)
    ti.sync()
