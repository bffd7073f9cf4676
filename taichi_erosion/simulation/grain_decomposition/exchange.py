"""Exchange of the grain decomposition: with columns of air, and with fields and states of effects.

The sums of `coupling.exchange` in another order: one thread sums the grains of a chunk, another the chunks of
a cell of air, one of each replica advances its column, and each grain gathers by itself. A chunk has the same
size in every run, so that a replica gives the same bits alone and in company.
"""

from typing import Any

from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.coupling_state import CouplingState
from taichi_erosion.coupling.deposit import deposit_part, part_count
from taichi_erosion.coupling.exchange import advance_loaded_column, update_cell_load
from taichi_erosion.coupling.gather import gather_grain
from taichi_erosion.grains import World
from taichi_erosion.grains.sleep import count_rest_exchanges, mark_unsettled_pairs, update_sleep_state
from taichi_erosion.grains.state import side_start
from taichi_erosion.simulation.grain_decomposition.buffers import Stage

CHUNK = 64  # grains that one thread sums; another number would give other bits


def chunks_for_grains(grains: int) -> int:
    return -(-grains // CHUNK)


@ti.func
def is_exchange_due(world: ti.template(), coupling: ti.template(), buffers: ti.template(), r):
    """Whether replica r exchanges before the coming step."""
    return buffers.stepping[r] == 1 and world.replicas.step[r] % coupling.exchange.look_steps[r] == 0


@ti.func
def is_first_exchange(world: ti.template(), coupling: ti.template(), buffers: ti.template(), r):
    """Whether the coming step of replica r is its first: its exchange is done twice."""
    return buffers.stepping[r] == 1 and world.replicas.step[r] == 0


@ti.func
def is_sleep_decided_now(world: ti.template(), coupling: ti.template(), buffers: ti.template(), r):
    """Whether sleep is decided now for the grains of replica r."""
    return is_exchange_due(world, coupling, buffers, r) and world.sleep.rest_least[r] > 0


@ti.func
def sum_chunk_by_cell(world_out: ti.template(), coupling_out: ti.template(), buffers: ti.template(), r, p):
    """Sums of the grains of one chunk in every cell of air."""
    if p < part_count(world_out, coupling_out, r):
        deposit_part(world_out, coupling_out, r, p)


@ti.func
def load_air_cell(world: ti.template(), coupling_out: ti.template(), buffers: ti.template(), r, c):
    """Residual momentum, void fraction and drag terms of one cell."""
    update_cell_load(world, coupling_out, r, c)


@ti.func
def advance_air_column(world: ti.template(), coupling_out: ti.template(), buffers: ti.template(), r, _):
    """The column of replica r at its next exchange."""
    advance_loaded_column(world, coupling_out, r)


def compile_air_force_task(updates_state: bool) -> Any:
    """Task: forces of air and fields on one grain; effects update its state where `updates_state`."""

    @ti.func
    def gather_air_force(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, rank):
        if rank < world_out.replicas.released[r]:
            i = side_start(world_out.grains, r, world_out.replicas.side[r]) + rank
            gather_grain(world_out, coupling, r, i, updates_state)

    return gather_air_force


def compile_sleep_task(change: Any) -> Any:
    """Task: one change of `grains.sleep` for one grain."""

    @ti.func
    def update_sleep(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, rank):
        if rank < world_out.replicas.released[r]:
            change(world_out, r, side_start(world_out.grains, r, world_out.replicas.side[r]) + rank)

    return update_sleep


GATHER, GATHER_ONLY = compile_air_force_task(True), compile_air_force_task(False)
SLEEP = tuple(map(compile_sleep_task, (count_rest_exchanges, mark_unsettled_pairs, update_sleep_state)))


def exchange_stages(world: World, coupling: CouplingState) -> tuple[Stage, ...]:
    """Stages of an exchange, each of which acts where it is due.

    The first exchange of all is done twice: the drag of grains needs the air, and the air the grains.
    """
    grains, stages = world.grains.capacity, []
    if coupling.air is not None:
        loads = (sum_chunk_by_cell, chunks_for_grains(grains)), (load_air_cell, coupling.air.cell_count)
        stages += [(is_first_exchange, task, width) for task, width in (*loads, (GATHER_ONLY, grains))]
        stages += [(is_exchange_due, task, width) for task, width in (*loads, (advance_air_column, 1))]
    if world.has_external_forces or world.has_state:
        stages.append((is_exchange_due, GATHER, grains))
    if world.sleeps:
        stages += [(is_sleep_decided_now, task, grains) for task in SLEEP]
    return tuple((task,) for task in stages)
