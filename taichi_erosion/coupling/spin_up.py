"""Letting the air find its steady profile over grains that keep their places and velocities."""

from taichi_erosion.air.column import advance_column
from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.deposit import deposit_partition
from taichi_erosion.coupling.exchange import reduce_residual, set_air_load
from taichi_erosion.coupling.gather import gather_partition

ROUNDS = 40  # times that drag rates follow the air
STEPS = 10  # of the air in a round: its eddies follow the flow by one step each
LONGEST = 1.0  # step of the air while it develops [s]; implicit, so its length costs nothing


@ti.func
def count_grains(world_out: ti.template(), coupling_out: ti.template(), r):
    """Sum up the grains of replica r, cell by cell."""
    for p in range(world_out.replicas.partitions[r]):
        deposit_partition(world_out, coupling_out, r, p)


@ti.kernel
def spin_up_column(
    # parameters
    r: ti.i32,
    anew: ti.i32,
    # out
    world_out: ti.template(),
    coupling_out: ti.template(),
):
    """Advance the column of replica r to its steady state, and let its grains feel that.

    What air and grains owe each other is put on the books first and stays there: it belongs to the time
    before. Where that time never was, because grains have been put back (`anew`), it is forgotten.
    """
    ti.loop_config(serialize=True)
    for turn in range(ROUNDS + 1):
        if turn > 0:
            for _ in range(STEPS):
                advance_column(coupling_out.air, r, LONGEST)
            for p in range(world_out.replicas.partitions[r]):
                gather_partition(world_out, coupling_out, r, p, False)
        count_grains(world_out, coupling_out, r)
        if turn == 0:
            reduce_residual(world_out, coupling_out, r)
            for c in range(coupling_out.air.cell_count * anew):
                coupling_out.exchange.residual_momentum[r, c] = (
                    0.0 * coupling_out.exchange.residual_momentum[r, c]
                )
        set_air_load(world_out, coupling_out, r)
