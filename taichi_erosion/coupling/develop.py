"""Letting the air find its steady profile over grains that stand still."""

from taichi_erosion.air.column import advance_column
from taichi_erosion.core.ti import ti

ROUNDS = 400  # steps of the air; eddies follow the flow by one step each
LONGEST = 1.0  # step of the air while it develops [s]; implicit, so its length costs nothing


@ti.kernel
def develop_air(
    # parameters
    r: ti.i32,
    # out
    around_out: ti.template(),
):
    """Advance the column of replica r to its steady state, the grains' drag frozen as at the last look."""
    ti.loop_config(serialize=True)
    for _ in range(ROUNDS):
        advance_column(around_out.air, r, LONGEST)
