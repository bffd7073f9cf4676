"""Letting the grid of air flow over grains that keep their places and velocities, while its eddies grow."""

from taichi_erosion.air.replica import advance_replica, each_column, remember_void_of
from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.develop import count_grains
from taichi_erosion.coupling.feel import feel_partition
from taichi_erosion.coupling.look import AIR, load_air, settle


@ti.func
def meet(world_out: ti.template(), around_out: ti.template(), r):
    """Let grains and air know each other as they stand."""
    load_air(world_out, around_out, r)
    each_column(remember_void_of, around_out.air, r)
    for p in range(world_out.replicas.partitions[r]):
        feel_partition(world_out, around_out, r, p)


@ti.kernel
def meet_air(
    # parameters
    r: ti.i32,
    anew: ti.i32,
    # out
    world_out: ti.template(),
    around_out: ti.template(),
):
    """Let grains feel an air that has been changed.

    What air and grains owe each other is put on the books first and stays there; where grains have been put
    back (`anew`), it is forgotten.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        count_grains(world_out, around_out, r)
        settle(world_out, around_out, r)
        for c in range(around_out.air.cell_count * anew):
            around_out.exchange.owed[r, c] = 0.0 * around_out.exchange.owed[r, c]
        meet(world_out, around_out, r)


@ti.kernel
def flow_over(
    # parameters
    r: ti.i32,
    steps: ti.i32,
    # out
    world_out: ti.template(),
    around_out: ti.template(),
):
    """Advance the grid of replica r over its grains by so many steps of the air, without booking anything."""
    ti.loop_config(serialize=True)
    for _ in range(steps):
        if world_out.replicas.status[r] == 0:
            if advance_replica(around_out.air, r) == 0:
                world_out.replicas.status[r] = AIR
            count_grains(world_out, around_out, r)
            meet(world_out, around_out, r)
