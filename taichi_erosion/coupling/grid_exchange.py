"""Exchange with a grid of air over the patch of grains, driven by the host between launches of the grains.

The exchange is that of a single column (`exchange.py`), with all three components of momentum. A grain of
volume V in the gradient of the pressure has the force  -V grad p,  of which its cells of air carry the share
1 - eps. Floor and lid take the vertical momentum that no velocity of the air can. The step of the air is the
time between two exchanges. A replica stops where its pressure does not converge.

Each replica exchanges at its own times: those that are selected take part. An exchange comes before the lists
of grains are rebuilt, and `last_exchange` is its step, so that none is done twice.
"""

from taichi_erosion.air.grid import apply_to_columns, store_previous_void
from taichi_erosion.air.pressure.conjugate_gradient import REPLICA_TOLERANCE
from taichi_erosion.air.step import advance_active_replicas
from taichi_erosion.core.snapshot import Status
from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.coupling_state import CouplingState
from taichi_erosion.coupling.deposit import deposit_part, part_count
from taichi_erosion.coupling.exchange import add_residual, return_residual, update_air_loads
from taichi_erosion.coupling.gather import gather_partition
from taichi_erosion.grains import World
from taichi_erosion.grains.sleep import update_sleep_states

AIR = int(Status.AIR)


@ti.func
def deposit_all_grains(world_out: ti.template(), coupling_out: ti.template(), r):
    """Deposit the grains of replica r, and set the drag terms of its air."""
    for p in range(part_count(world_out, coupling_out, r)):
        deposit_part(world_out, coupling_out, r, p)
    update_air_loads(world_out, coupling_out, r)


@ti.func
def gather_all_grains(world_out: ti.template(), coupling: ti.template(), r, updates_state):
    """Gather the frozen terms of all grains of replica r."""
    for p in range(world_out.replicas.partitions[r]):
        gather_partition(world_out, coupling, r, p, updates_state)


@ti.func
def match_replica_air(world_out: ti.template(), coupling_out: ti.template(), r):
    """Void fraction, drag terms and frozen drag of replica r from its present state; nothing advances."""
    deposit_all_grains(world_out, coupling_out, r)
    apply_to_columns(store_previous_void, coupling_out.air, r, r + 1)
    gather_all_grains(world_out, coupling_out, r, False)


@ti.func
def begin_exchange(world_out: ti.template(), coupling_out: ti.template(), r):
    """Deposit the grains of replica r for the step of its air."""
    deposit_all_grains(world_out, coupling_out, r)
    return_residual(coupling_out, r, coupling_out.air.numbers.time_step[r])


@ti.func
def end_exchange(world_out: ti.template(), coupling_out: ti.template(), r):
    """Residual momentum and frozen terms of replica r after the step of its air."""
    add_residual(coupling_out, r, coupling_out.air.numbers.time_step[r])
    gather_all_grains(world_out, coupling_out, r, True)
    if ti.static(world_out.sleeps):
        update_sleep_states(world_out, r, 0, 1, 1)
    coupling_out.exchange.last_exchange[r] = world_out.replicas.step[r]
    if not coupling_out.air.mass_residual[r] <= REPLICA_TOLERANCE:
        world_out.replicas.status[r] = AIR


@ti.kernel
def each_selected_replica(
    task: ti.template(), count: ti.i32, chunk: ti.i32, world_out: ti.template(), coupling_out: ti.template()
):
    for lane in range(count * chunk):
        if lane % chunk == 0 and coupling_out.air.active[lane // chunk] == 1:
            task(world_out, coupling_out, lane // chunk)


def match_air_to_grains(world: World, coupling: CouplingState, count: int, chunk: int) -> None:
    """Drag and void fraction of the selected replicas from their present state."""
    each_selected_replica(match_replica_air, count, chunk, world, coupling)


def exchange_with_grids(world: World, coupling: CouplingState, count: int, chunk: int) -> None:
    """One exchange of all grains of the selected replicas."""
    assert coupling.air is not None
    each_selected_replica(begin_exchange, count, chunk, world, coupling)
    advance_active_replicas(coupling.air, count, chunk)
    each_selected_replica(end_exchange, count, chunk, world, coupling)
