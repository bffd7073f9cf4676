"""Exchange of the grain decomposition: with columns of air, and with fields and states of effects.

The sums of `coupling.exchange` in another order: one thread sums the grains of a chunk, another the chunks of
a cell of air, one of each replica advances its column, and each grain gathers by itself. A chunk has the same
size in every run, so that a replica gives the same bits alone and in company.
"""

from taichi_erosion.air.single_column import advance_column
from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.coupling_state import CouplingState
from taichi_erosion.coupling.deposit import deposit_part, part_count
from taichi_erosion.coupling.exchange import advance_loaded_column, reduce_cell, set_cell_load
from taichi_erosion.coupling.gather import gather_grain
from taichi_erosion.coupling.spin_up import LONGEST, ROUNDS, STEPS
from taichi_erosion.grains import World
from taichi_erosion.grains.sleep import count_rest, mark_unsettled, update_sleep_state
from taichi_erosion.grains.state import side_block
from taichi_erosion.simulation.grain_decomposition.buffers import GrainBuffers, Stages

CHUNK = 64  # grains that one thread sums; another number would give other bits


def chunk_count(grains: int) -> int:
    """Chunks of a replica of so many grains."""
    return -(-grains // CHUNK)


@ti.func
def is_moving(world: ti.template(), buffers: ti.template(), r, rank):
    """Whether the coming step advances a grain."""
    return buffers.stepping[r] == 1 and rank < world.replicas.released[r]


@ti.func
def is_due(world: ti.template(), coupling: ti.template(), buffers: ti.template(), r):
    """Whether replica r exchanges before the coming step."""
    return buffers.stepping[r] == 1 and world.replicas.step[r] % coupling.exchange.look_steps[r] == 0


@ti.func
def is_first(world: ti.template(), buffers: ti.template(), r):
    """Whether the coming step of replica r is its first: its exchange is done twice."""
    return buffers.stepping[r] == 1 and world.replicas.step[r] == 0


@ti.func
def place_of(world: ti.template(), r, rank):
    """Place of a grain."""
    return side_block(world.grains, r, world.replicas.side[r]) + rank


@ti.func
def sum_chunk_of_grains(world_out: ti.template(), coupling_out: ti.template(), buffers: ti.template(), r, p):
    """Sums of the grains of one chunk in every cell of air."""
    if p < part_count(world_out, coupling_out, r):
        deposit_part(world_out, coupling_out, r, p)


@ti.func
def load_cell(world: ti.template(), coupling_out: ti.template(), buffers: ti.template(), r, c):
    """Void fraction and drag terms of one cell, from the sums of all chunks."""
    set_cell_load(world, coupling_out, r, ti.Vector([0, 0]), c)


@ti.func
def receive_in_cell(world: ti.template(), coupling_out: ti.template(), buffers: ti.template(), r, c):
    """Residual momentum, void fraction and drag terms of one cell."""
    reduce_cell(world, coupling_out, r, c)
    load_cell(world, coupling_out, buffers, r, c)


@ti.func
def gather_frozen(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, rank):
    """Frozen terms of one grain; effects keep their states."""
    if rank < world_out.replicas.released[r]:
        gather_grain(world_out, coupling, r, place_of(world_out, r, rank), False)


@ti.func
def clear_cell_residual(world: ti.template(), coupling_out: ti.template(), buffers: ti.template(), r, c):
    """Zero residual momentum of one cell."""
    exchange_out = ti.static(coupling_out.exchange)
    exchange_out.residual_momentum[r, c] = 0.0 * exchange_out.residual_momentum[r, c]


@ti.func
def spin_up_step(world: ti.template(), coupling_out: ti.template(), buffers: ti.template(), r, _):
    """The column of replica r after one long step."""
    advance_column(coupling_out.air, r, LONGEST)


@ti.func
def sum_first(world_out: ti.template(), coupling_out: ti.template(), buffers: ti.template(), r, p):
    """Sums of one chunk before the first exchange of all."""
    if is_first(world_out, buffers, r):
        sum_chunk_of_grains(world_out, coupling_out, buffers, r, p)


@ti.func
def receive_first(world: ti.template(), coupling_out: ti.template(), buffers: ti.template(), r, c):
    """Terms of one cell before the first exchange of all."""
    if is_first(world, buffers, r):
        receive_in_cell(world, coupling_out, buffers, r, c)


@ti.func
def gather_first(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, rank):
    """Frozen terms of one grain before the first exchange of all."""
    if is_first(world_out, buffers, r):
        gather_frozen(world_out, coupling, buffers, r, rank)


@ti.func
def sum_due(world_out: ti.template(), coupling_out: ti.template(), buffers: ti.template(), r, p):
    """Sums of one chunk, where its exchange is due."""
    if is_due(world_out, coupling_out, buffers, r):
        sum_chunk_of_grains(world_out, coupling_out, buffers, r, p)


@ti.func
def receive_due(world: ti.template(), coupling_out: ti.template(), buffers: ti.template(), r, c):
    """Terms of one cell, where its exchange is due."""
    if is_due(world, coupling_out, buffers, r):
        receive_in_cell(world, coupling_out, buffers, r, c)


@ti.func
def advance_due(world: ti.template(), coupling_out: ti.template(), buffers: ti.template(), r, _):
    """The column of replica r at its next exchange, where this one is due."""
    if is_due(world, coupling_out, buffers, r):
        advance_loaded_column(world, coupling_out, r)


@ti.func
def gather_due(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, rank):
    """Forces of air and fields and states of effects of one grain, where its exchange is due."""
    if is_due(world_out, coupling, buffers, r) and is_moving(world_out, buffers, r, rank):
        gather_grain(world_out, coupling, r, place_of(world_out, r, rank), True)


@ti.func
def may_sleep(world: ti.template(), coupling: ti.template(), buffers: ti.template(), r, rank):
    """Whether sleep is decided now for a grain."""
    due = is_due(world, coupling, buffers, r) and is_moving(world, buffers, r, rank)
    return due and world.sleep.rest_least[r] > 0


@ti.func
def count_rest_due(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, rank):
    """Exchanges in a row at which a grain was at rest."""
    if may_sleep(world_out, coupling, buffers, r, rank):
        count_rest(world_out, r, place_of(world_out, r, rank))


@ti.func
def mark_unsettled_due(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, rank):
    """Marks of the grains that touch one that has not rested long enough."""
    if may_sleep(world_out, coupling, buffers, r, rank):
        mark_unsettled(world_out, r, place_of(world_out, r, rank))


@ti.func
def update_sleep_due(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, rank):
    """Sleep or waking of a grain."""
    if may_sleep(world_out, coupling, buffers, r, rank):
        update_sleep_state(world_out, r, place_of(world_out, r, rank))


def exchange_stages(world: World, coupling: CouplingState) -> Stages:
    """Stages of an exchange, each of which acts where it is due."""
    grains = world.grains.capacity
    stages: Stages = ()
    if coupling.air is not None:
        cells = coupling.air.cell_count
        stages = ((sum_due, chunk_count(grains)), (receive_due, cells), (advance_due, 1))
    if world.driven or world.has_state:
        stages = (*stages, (gather_due, grains))
    if world.sleeps:
        tasks = (count_rest_due, mark_unsettled_due, update_sleep_due)
        stages = (*stages, *((task, grains) for task in tasks))
    return stages


def first_exchange_stages(world: World, coupling: CouplingState) -> Stages:
    """Stages before the first exchange of all: the drag of grains needs the air, and the air the grains."""
    if coupling.air is None:
        return ()
    grains, cells = world.grains.capacity, coupling.air.cell_count
    return (sum_first, chunk_count(grains)), (receive_first, cells), (gather_first, grains)


@ti.kernel
def run_in_replica(
    # parameters
    stages: ti.template(),
    r: ti.i32,
    # out
    world_out: ti.template(),
    coupling_out: ti.template(),
    buffers_out: ti.template(),
):
    """Run stages one after the other for one replica; it writes what they write."""
    for stage in ti.static(stages):
        task, width = ti.static(stage)
        for k in range(width):
            task(world_out, coupling_out, buffers_out, r, k)


def spin_up(world: World, coupling: CouplingState, buffers: GrainBuffers, replica: int, anew: bool) -> None:
    """Steady profile of a column over grains that are held: `coupling.spin_up.spin_up_column` in stages."""
    assert coupling.air is not None
    grains, cells = world.grains.capacity, coupling.air.cell_count
    sums = (sum_chunk_of_grains, chunk_count(grains))
    begin, cleared = (sums, (receive_in_cell, cells)), ((clear_cell_residual, cells),)
    advanced, matched = ((spin_up_step, 1),), ((gather_frozen, grains), sums, (load_cell, cells))
    run_in_replica(begin, replica, world, coupling, buffers)
    if anew:
        run_in_replica(cleared, replica, world, coupling, buffers)
    for _ in range(ROUNDS):
        for _ in range(STEPS):
            run_in_replica(advanced, replica, world, coupling, buffers)
        run_in_replica(matched, replica, world, coupling, buffers)
