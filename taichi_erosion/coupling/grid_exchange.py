"""Looks of grains at a grid of air over their patch, which the host drives between launches of the grains.

They do what `look.py` does for a single column, with all three components of momentum. A grain of volume V
in the gradient of the pressure gets  -V grad p,  the share 1 - eps that the air of its cells has not taken of
it. Floor and lid take the vertical momentum that no velocity of the air can. The step of the air is the time
from one look to the next. A look stops the replica whose pressure is not found.

Each replica looks in its own time: those are `moving` that do so now. Looks come before the lists of grains
are renewed, and `looked` remembers the step of the last, so that none is taken twice.
"""

from taichi_erosion.air.exchange_budget import remember_void_of
from taichi_erosion.air.interpolation import cell_volume
from taichi_erosion.air.replica_step import TOLERANCE, advance_moving, each_column
from taichi_erosion.core.snapshot import Status
from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.coupling_state import Surroundings
from taichi_erosion.coupling.deposit import give_partition
from taichi_erosion.coupling.exchange import load_air, settle
from taichi_erosion.coupling.gather import feel_partition
from taichi_erosion.grains.sleep import lull
from taichi_erosion.grains.world import World

AIR = int(Status.AIR)


@ti.func
def place_of(air: ti.template(), c):
    """Place (i, j, k) of a cell by its number."""
    (n,) = ti.static((air.cells,))
    return c // (n[1] * n[2]), c // n[2] % n[1], c % n[2]


@ti.func
def hand_back(around_out: ti.template(), r):
    """Give the air what is owed to its grains, spread over the coming step."""
    air_out, exchange = ti.static((around_out.air, around_out.exchange))
    for c in range(air_out.cell_count):
        i, j, k = place_of(air_out, c)
        back = exchange.owed[r, c] / (air_out.numbers.time_step[r] * cell_volume(air_out, r, k))
        air_out.exchange_force[r, i, j, k] = air_out.exchange_force[r, i, j, k] + back


@ti.func
def note_loss(around_out: ti.template(), r):
    """Owe the grains what the air has lost in the last step."""
    air, exchange_out = ti.static((around_out.air, around_out.exchange))
    for c in range(air.cell_count):
        i, j, k = place_of(air, c)
        gained = air.impulse[r, i, j, k] * cell_volume(air, r, k)
        exchange_out.owed[r, c] = exchange_out.owed[r, c] - gained


@ti.func
def count_grains(world_out: ti.template(), around_out: ti.template(), r):
    """Sum up the grains of replica r, cell by cell, and put what they got off the books."""
    for p in range(world_out.replicas.partitions[r]):
        give_partition(world_out, around_out, r, p)
    settle(world_out, around_out, r)
    load_air(world_out, around_out, r)


@ti.func
def feel_all(world_out: ti.template(), around: ti.template(), r, counts):
    """Renew what all grains of replica r hold; a look that `counts` is remembered by the effects."""
    for p in range(world_out.replicas.partitions[r]):
        feel_partition(world_out, around, r, p, counts)


@ti.func
def meet(world_out: ti.template(), around_out: ti.template(), r):
    """Let grains and air of replica r know each other."""
    count_grains(world_out, around_out, r)
    each_column(remember_void_of, around_out.air, r)
    feel_all(world_out, around_out, r, False)


@ti.func
def forget(world_out: ti.template(), around_out: ti.template(), r):
    """Let grains and air of replica r owe each other nothing."""
    for c in range(around_out.air.cell_count):
        around_out.exchange.owed[r, c] = 0.0 * around_out.exchange.owed[r, c]


@ti.func
def begin_look(world_out: ti.template(), around_out: ti.template(), r):
    """Sum up the grains of replica r for the step of its air."""
    count_grains(world_out, around_out, r)
    hand_back(around_out, r)


@ti.func
def end_look(world_out: ti.template(), around_out: ti.template(), r):
    """Book what the air of replica r has lost, and let the grains feel it."""
    note_loss(around_out, r)
    feel_all(world_out, around_out, r, True)
    if ti.static(world_out.sleeps):
        lull(world_out, r, 0, 1, 1)
    around_out.exchange.looked[r] = world_out.replicas.step[r]
    if not around_out.air.left[r] <= TOLERANCE:
        world_out.replicas.status[r] = AIR


@ti.kernel
def each_moving_patch(
    # parameters
    task: ti.template(),
    count: ti.i32,
    chunk: ti.i32,
    # out
    world_out: ti.template(),
    around_out: ti.template(),
):
    """Do one task for every moving replica."""
    for lane in range(count * chunk):
        if lane % chunk == 0 and around_out.air.moving[lane // chunk] == 1:
            task(world_out, around_out, lane // chunk)


def meet_air(world: World, around: Surroundings, count: int, chunk: int) -> None:
    """Let grains and air of the moving replicas know each other."""
    each_moving_patch(meet, count, chunk, world, around)


def forget_debts(world: World, around: Surroundings, count: int, chunk: int) -> None:
    """Let grains and air of the moving replicas owe each other nothing."""
    each_moving_patch(forget, count, chunk, world, around)


def look_at_grids(world: World, around: Surroundings, count: int, chunk: int) -> None:
    """One look of all grains of the moving replicas."""
    assert around.air is not None
    each_moving_patch(begin_look, count, chunk, world, around)
    advance_moving(around.air, count, chunk)
    each_moving_patch(end_look, count, chunk, world, around)
