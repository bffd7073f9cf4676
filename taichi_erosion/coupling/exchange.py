"""The look: grains hand the air what they took from it, the air moves on, and the grains feel it anew.

Between two looks the drag on a grain is held as a rate b towards a velocity (`grains.held`). At a look

    1  every cell sums up volume, m b and m b v of its grains, and the momentum P that drag has given them;
    2  P settles part of what is `owed`: momentum that the air has lost and its grains have not yet got;
    3  the air advances with the drag  -sum m b (u - v)  taken implicitly, so no rate is too fast for it, and
       gets back what is owed, spread over the step dt. What it then loses is owed anew. Over any time, what
       the air lost is what the grains got plus what is owed, to rounding;
    4  every grain receives the mean velocity of its cells and all other forces.

In 1 to 3 b stands for b / (1 + b h), which is what the grains' own implicit steps h pass on. A grain that its
contacts hold then takes in n steps just what the air gives, and a free one less: the difference u - v shrinks
at any rate, and never changes its sign. The first of all looks is taken twice, at first without 3: grains and
air must know each other before they exchange anything.

A grain that reaches through several cells takes more from the faster ones: of its momentum p, the cell k
with velocity u_k and a share s_k of the grain gives  s_k (p + m b dt (u_k - sum s_l u_l)),  all cells p.
Giving s_k p would drag the air between the grains backwards.

The grids of air of `patch.py` exchange all three components so. Vertical momentum of a single column is
carried by the pressure. Where air rises through the bed with the superficial velocity W,
continuity and the balance of drag and pressure give, layer by layer,

    w = (W - sum V v_z / V_cell) / eps,    -dp/dz = sum m b (w - v_z) / (V_cell eps).
"""

from taichi_erosion.air.column import advance_column
from taichi_erosion.air.grid import cell_volume
from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.deposit import buffer_row, cell_index, deposit_partition, exchange_interval
from taichi_erosion.coupling.gather import gather_partition
from taichi_erosion.coupling.weights import wind_of
from taichi_erosion.grains.partition import barrier, owns_partition
from taichi_erosion.grains.sleep import update_sleep

real = ti.f64

VOID_LEAST = 0.05  # of a layer that grains of one height fill: keeps velocities between grains finite [1]


@ti.func
def sum_partitions(world: ti.template(), coupling: ti.template(), r, c):
    """Volume, rate, pull and vertical flow of all grains in a cell."""
    (sums,) = ti.static((coupling.sums,))
    row = buffer_row(world, r, 0)
    volume, rate, flow = sums.volume[row, c], sums.rate[row, c], sums.flow[row, c]
    pull = sums.pull[row, c]
    for p in range(1, world.replicas.partitions[r]):
        row = buffer_row(world, r, p)
        volume += sums.volume[row, c]
        rate += sums.rate[row, c]
        flow += sums.flow[row, c]
        pull += sums.pull[row, c]
    return volume, rate, pull, flow


@ti.func
def exchanged_part(air: ti.template(), momentum):
    """The part that is exchanged: of a column the level one, since vertical momentum is the pressure's."""
    part = momentum
    if ti.static(air.is_column):
        part = ti.Vector([momentum[0], momentum[1], real(0.0)])
    return part


@ti.func
def reduce_residual(world: ti.template(), coupling_out: ti.template(), r):
    """Take what the grains have got off what is owed to them."""
    sums, exchange_out = ti.static((coupling_out.sums, coupling_out.exchange))
    for c in range(coupling_out.air.cell_count):
        for p in range(world.replicas.partitions[r]):
            impulse = sums.impulse[buffer_row(world, r, p), c]
            exchange_out.residual_momentum[r, c] = exchange_out.residual_momentum[r, c] - exchanged_part(
                coupling_out.air, impulse
            )


@ti.func
def set_cell_load(world: ti.template(), coupling_out: ti.template(), r, column, k):
    """Write void fraction and exchange of one cell."""
    air_out, exchange_out = ti.static((coupling_out.air, coupling_out.exchange))
    i, j = column[0], column[1]
    volume, rate, pull, flow = sum_partitions(world, coupling_out, r, cell_index(air_out, column, k))
    cell = cell_volume(air_out, r, k)
    void = ti.max(1.0 - volume / cell, VOID_LEAST)
    air_out.void_fraction[r, i, j, k] = void
    air_out.exchange_coefficient[r, i, j, k] = rate / cell
    air_out.exchange_force[r, i, j, k] = pull / cell
    if ti.static(coupling_out.has_through_flow):
        rise = (exchange_out.through_flow[r] - flow / cell) / void
        exchange_out.rise[r, k] = rise
        exchange_out.lift[r, k] = (rate * rise - pull[2]) / (cell * void)


@ti.func
def set_air_load(world: ti.template(), coupling_out: ti.template(), r):
    """Write void fraction and exchange of every cell for the coming steps of the air."""
    for i in range(coupling_out.air.cells[0]):
        for j in range(coupling_out.air.cells[1]):
            for k in range(coupling_out.air.cells[2]):
                set_cell_load(world, coupling_out, r, ti.Vector([i, j]), k)


@ti.func
def column_drag(air: ti.template(), r, k):
    """Force of the grains on a layer of a column of air [N m-3]."""
    force = exchanged_part(air, air.exchange_force[r, 0, 0, k])
    return force - air.exchange_coefficient[r, 0, 0, k] * wind_of(air, r, ti.Vector([0, 0]), k)


@ti.func
def advance_loaded_column(world: ti.template(), coupling_out: ti.template(), r):
    """Let the column of replica r move on until the next look."""
    air_out, exchange_out = ti.static((coupling_out.air, coupling_out.exchange))
    interval = exchange_interval(world, coupling_out, r)
    for k in range(air_out.cells[2]):
        back = exchange_out.residual_momentum[r, k] / (interval * cell_volume(air_out, r, k))
        air_out.exchange_force[r, 0, 0, k] = air_out.exchange_force[r, 0, 0, k] + back
    advance_column(air_out, r, interval)
    for k in range(air_out.cells[2]):
        gained = column_drag(air_out, r, k) * (interval * cell_volume(air_out, r, k))
        exchange_out.residual_momentum[r, k] = exchange_out.residual_momentum[r, k] - gained


@ti.func
def deposit_and_advance(
    world_out: ti.template(), coupling_out: ti.template(), r, member, size, turn, advances
):
    """Sum up the grains, cell by cell, and let the air move on where it `advances`; the next meeting."""
    (replicas_out,) = ti.static((world_out.replicas,))
    for p in range(replicas_out.partitions[r]):
        if owns_partition(replicas_out, r, p, member, size):
            deposit_partition(world_out, coupling_out, r, p)
    turn = barrier(replicas_out, r, size, turn)
    if member == 0:
        reduce_residual(world_out, coupling_out, r)
        set_air_load(world_out, coupling_out, r)
        if advances:
            advance_loaded_column(world_out, coupling_out, r)
    return barrier(replicas_out, r, size, turn)


@ti.func
def exchange_momentum(world_out: ti.template(), coupling_out: ti.template(), r, member, size, turn):
    """One look of all grains of replica r; returns the next meeting of the team."""
    (replicas_out,) = ti.static((world_out.replicas,))
    before = ti.select(replicas_out.step[r] == 0, 1, 0)
    for passage in range(before + 1):
        if ti.static(coupling_out.has_air):
            turn = deposit_and_advance(world_out, coupling_out, r, member, size, turn, passage == before)
        for p in range(replicas_out.partitions[r]):
            if owns_partition(replicas_out, r, p, member, size):
                gather_partition(world_out, coupling_out, r, p, passage == before)
    if ti.static(world_out.has_state):
        # forces read what is remembered of grains of other partitions
        turn = barrier(replicas_out, r, size, turn)
    if ti.static(world_out.sleeps):
        turn = update_sleep(world_out, r, member, size, turn)
    return turn
