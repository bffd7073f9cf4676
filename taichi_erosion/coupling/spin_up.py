"""Spin-up: the steady profile of the air over grains that keep their places and velocities."""

from taichi_erosion.air.single_column import advance_column
from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.deposit import deposit_part, part_count
from taichi_erosion.coupling.exchange import reduce_residual, set_air_load
from taichi_erosion.coupling.gather import gather_partition

ROUNDS = 40  # updates of the drag rates
STEPS = 10  # of the air in a round: its eddy viscosity lags the flow by one step
LONGEST = 1.0  # step of the air while it develops [s]; implicit, so stable at any length


@ti.func
def deposit_all(world_out: ti.template(), coupling_out: ti.template(), r):
    """Deposit the grains of replica r."""
    for p in range(part_count(world_out, coupling_out, r)):
        deposit_part(world_out, coupling_out, r, p)


@ti.kernel
def spin_up_column(
    # parameters
    r: ti.i32,
    anew: ti.i32,
    # out
    world_out: ti.template(),
    coupling_out: ti.template(),
):
    """Advance the column of replica r to its steady state, and gather its drag.

    The residual momentum is brought up to date first and kept: it belongs to the time before. Where that time
    does not count, because grains have been put back (`anew`), it is cleared.

    Writes `coupling_out`: air, exchange, sums.
    Writes `world_out`: frozen_drag.air_velocity, frozen_drag.drag_kick, frozen_drag.drag_rate,
    frozen_drag.steady_acceleration, frozen_drag.steady_spin_rate, grain_effects.states, pair_effects.states.
    """
    ti.loop_config(serialize=True)
    for cycle in range(ROUNDS + 1):
        if cycle > 0:
            for _ in range(STEPS):
                advance_column(coupling_out.air, r, LONGEST)
            for p in range(world_out.replicas.partitions[r]):
                gather_partition(world_out, coupling_out, r, p, False)
        deposit_all(world_out, coupling_out, r)
        if cycle == 0:
            reduce_residual(world_out, coupling_out, r)
            for c in range(coupling_out.air.cell_count * anew):
                coupling_out.exchange.residual_momentum[r, c] = (
                    0.0 * coupling_out.exchange.residual_momentum[r, c]
                )
        set_air_load(world_out, coupling_out, r)
