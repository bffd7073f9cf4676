"""Two-way momentum exchange: deposit the drag of the grains, advance the air, gather the new drag per grain.

Between two exchanges the drag on a grain is a rate b towards a velocity (`grains.frozen_drag`). An exchange

    1  sums volume, m b and m b v of the grains of every cell, and the momentum P that drag has given them;
    2  subtracts P from the residual momentum: what the air has lost and its grains have not yet received;
    3  advances the air with the drag  -sum m b (u - v)  taken implicitly, so no rate is too fast for it, and
       with the residual returned as a force, spread over the step dt. What the air then loses is the new
       residual. Over any time, the loss of the air is the gain of the grains plus the residual, to rounding;
    4  gathers for every grain the mean velocity of its cells and all other forces.

In 1 to 3 b stands for b / (1 + b h), the rate of the grains' own implicit steps h. A grain that its contacts
fix then receives in n steps just what the air loses, and a free one less: the difference u - v shrinks at any
rate, and never changes its sign. The first exchange of all is done twice, at first without 3, since the drag
of the grains needs the air, and the air the grains.

A grain that reaches through several cells receives more from the faster ones: of its momentum p, the cell k
with velocity u_k and a share s_k of the grain gives  s_k (p + m b dt (u_k - sum s_l u_l)),  all cells p.
With s_k p alone the air between the grains would be dragged backwards.

Grids of air exchange all three components (`grid_exchange.py`). Vertical momentum of a single column is
balanced by the pressure. Where air rises through the bed with the superficial velocity W,
continuity and the balance of drag and pressure give, layer by layer,

    w = (W - sum V v_z / V_cell) / eps,    -dp/dz = sum m b (w - v_z) / (V_cell eps).
"""

from taichi_erosion.air.grid import cell_volume
from taichi_erosion.air.single_column import advance_column
from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.coupling_state import CouplingState
from taichi_erosion.coupling.deposit import buffer_row, cell_wind, deposit_part, exchange_interval, part_count
from taichi_erosion.coupling.gather import gather_grain, gather_partition
from taichi_erosion.grains import World
from taichi_erosion.grains.partition import owns_partition, wait_at_barrier
from taichi_erosion.grains.sleep import update_sleep_states
from taichi_erosion.grains.state import side_start

real = ti.f64

ROUNDS = 40  # of a spin-up: updates of the drag rates
STEPS = 10  # of the air in a round: its eddy viscosity lags the flow by one step
LONGEST = 1.0  # step of the air while it develops [s]; implicit, so stable at any length
VOID_LEAST = 0.05  # of a layer that grains of one height fill: keeps velocities between grains finite [1]


@ti.func
def cell_sum_of_parts(world: ti.template(), coupling: ti.template(), r, c):
    """Volume, rate, drag source and vertical flow of all grains in a cell."""
    (sums,) = ti.static((coupling.sums,))
    row = buffer_row(world, r, 0)
    volume, rate, volume_flow = sums.volume[row, c], sums.rate[row, c], sums.volume_flow[row, c]
    drag_source = sums.drag_source[row, c]
    for p in range(1, part_count(world, coupling, r)):
        row = buffer_row(world, r, p)
        volume += sums.volume[row, c]
        rate += sums.rate[row, c]
        volume_flow += sums.volume_flow[row, c]
        drag_source += sums.drag_source[row, c]
    return volume, rate, drag_source, volume_flow


@ti.func
def exchanged_part(air: ti.template(), momentum):
    """Exchanged part of a momentum: of a column the horizontal one; the pressure balances the vertical."""
    part = momentum
    if ti.static(air.is_column):
        part = ti.Vector([momentum[0], momentum[1], real(0.0)])
    return part


@ti.func
def cell_indices(air: ti.template(), c):
    """Indices (i, j, k) of cell c of a replica."""
    (n,) = ti.static((air.cells,))
    return c // (n[1] * n[2]), c // n[2] % n[1], c % n[2]


@ti.func
def reduce_residual(world: ti.template(), coupling_out: ti.template(), r, c):
    """Subtract the momentum that the grains in a cell have received from its residual."""
    sums, exchange_out = ti.static((coupling_out.sums, coupling_out.exchange))
    for p in range(part_count(world, coupling_out, r)):
        impulse = exchanged_part(coupling_out.air, sums.impulse[buffer_row(world, r, p), c])
        exchange_out.residual_momentum[r, c] = exchange_out.residual_momentum[r, c] - impulse


@ti.func
def set_cell_load(world: ti.template(), coupling_out: ti.template(), r, c):
    """Void fraction and drag terms of one cell for the coming steps of the air."""
    air_out, exchange_out = ti.static((coupling_out.air, coupling_out.exchange))
    i, j, k = cell_indices(air_out, c)
    volume, rate, drag_source, volume_flow = cell_sum_of_parts(world, coupling_out, r, c)
    cell = cell_volume(air_out, r, k)
    void = ti.max(1.0 - volume / cell, VOID_LEAST)
    air_out.void_fraction[r, i, j, k] = void
    air_out.exchange_coefficient[r, i, j, k] = rate / cell
    air_out.exchange_force[r, i, j, k] = drag_source / cell
    if ti.static(coupling_out.has_through_flow):
        rise_velocity = (exchange_out.through_flow[r] - volume_flow / cell) / void
        exchange_out.rise_velocity[r, k] = rise_velocity
        exchange_out.pressure_lift[r, k] = (rate * rise_velocity - drag_source[2]) / (cell * void)


@ti.func
def update_cell_load(world: ti.template(), coupling_out: ti.template(), r, c):
    """Residual momentum, void fraction and drag terms of one cell, from the sums of all parts."""
    reduce_residual(world, coupling_out, r, c)
    set_cell_load(world, coupling_out, r, c)


@ti.func
def update_air_loads(world: ti.template(), coupling_out: ti.template(), r):
    """Residual momentum, void fraction and drag terms of every cell."""
    for c in range(coupling_out.air.cell_count):
        update_cell_load(world, coupling_out, r, c)


@ti.func
def return_residual(coupling_out: ti.template(), r, interval):
    """Return the residual momentum to the air as a force over a step [s] of it."""
    air_out, exchange = ti.static((coupling_out.air, coupling_out.exchange))
    for c in range(air_out.cell_count):
        i, j, k = cell_indices(air_out, c)
        back = exchange.residual_momentum[r, c] / (interval * cell_volume(air_out, r, k))
        air_out.exchange_force[r, i, j, k] = air_out.exchange_force[r, i, j, k] + back


@ti.func
def add_residual(coupling_out: ti.template(), r, interval):
    """Add what the air has lost in its last step [s] to the residual momentum."""
    air, exchange_out = ti.static((coupling_out.air, coupling_out.exchange))
    for c in range(air.cell_count):
        i, j, k = cell_indices(air, c)
        gained = air.impulse[r, i, j, k] * cell_volume(air, r, k)
        if ti.static(air.is_column):
            drag = air.exchange_coefficient[r, i, j, k] * cell_wind(air, r, ti.Vector([i, j]), k)
            force = exchanged_part(air, air.exchange_force[r, i, j, k]) - drag  # of the grains [N m-3]
            gained = force * (interval * cell_volume(air, r, k))
        exchange_out.residual_momentum[r, c] = exchange_out.residual_momentum[r, c] - gained


@ti.func
def advance_loaded_column(world: ti.template(), coupling_out: ti.template(), r):
    """Advance the column of replica r to the next exchange."""
    interval = exchange_interval(world, coupling_out, r)
    return_residual(coupling_out, r, interval)
    advance_column(coupling_out.air, r, interval)
    add_residual(coupling_out, r, interval)


@ti.func
def deposit_and_advance(
    world_out: ti.template(), coupling_out: ti.template(), r, member, size, phase, advances
):
    """Deposit the grains and, where `advances`, advance the air; returns the next barrier."""
    (replicas_out,) = ti.static((world_out.replicas,))
    for p in range(replicas_out.partitions[r]):
        if owns_partition(replicas_out, r, p, member, size):
            deposit_part(world_out, coupling_out, r, p)
    phase = wait_at_barrier(replicas_out, r, size, phase)
    if member == 0:
        update_air_loads(world_out, coupling_out, r)
        if advances:
            advance_loaded_column(world_out, coupling_out, r)
    return wait_at_barrier(replicas_out, r, size, phase)


@ti.func
def exchange_momentum(world_out: ti.template(), coupling_out: ti.template(), r, member, size, phase):
    """One exchange of all grains of replica r; returns the next barrier."""
    (replicas_out,) = ti.static((world_out.replicas,))
    before = ti.select(replicas_out.step[r] == 0, 1, 0)
    for passage in range(before + 1):
        is_last = passage == before
        if ti.static(coupling_out.has_air):
            phase = deposit_and_advance(world_out, coupling_out, r, member, size, phase, is_last)
        for p in range(replicas_out.partitions[r]):
            if owns_partition(replicas_out, r, p, member, size):
                gather_partition(world_out, coupling_out, r, p, is_last)
    if ti.static(world_out.has_state):
        # forces read state variables of grains of other partitions
        phase = wait_at_barrier(replicas_out, r, size, phase)
    if ti.static(world_out.sleeps):
        phase = update_sleep_states(world_out, r, member, size, phase)
    return phase


@ti.func
def set_spin_up_load(world: ti.template(), coupling_out: ti.template(), r, c, number, anew):
    """Drag terms of one cell in a round of a spin-up; the first brings its residual up to date."""
    if number == 0:
        reduce_residual(world, coupling_out, r, c)
    if anew == 1:
        coupling_out.exchange.residual_momentum[r, c] = 0.0 * coupling_out.exchange.residual_momentum[r, c]
    set_cell_load(world, coupling_out, r, c)


@ti.kernel
def run_spin_up_round(
    r: ti.i32, number: ti.i32, anew: ti.i32, world_out: ti.template(), coupling_out: ti.template()
):
    """Steps of the column of replica r over grains that keep their places and its drag; round 0: none."""
    ti.loop_config(serialize=True)
    for _ in range(ti.select(number > 0, STEPS, 0)):
        advance_column(coupling_out.air, r, LONGEST)
    for rank in range(world_out.grains.capacity):
        if number > 0 and rank < world_out.replicas.released[r]:
            i = side_start(world_out.grains, r, world_out.replicas.side[r]) + rank
            gather_grain(world_out, coupling_out, r, i, False)
    for p in range(coupling_out.sums.parts):
        if p < part_count(world_out, coupling_out, r):
            deposit_part(world_out, coupling_out, r, p)
    for c in range(coupling_out.air.cell_count):
        set_spin_up_load(world_out, coupling_out, r, c, number, anew)


def spin_up_column(world: World, coupling: CouplingState, replica: int, anew: bool) -> None:
    """Spin-up: steady profile of the column of a replica over grains that keep their places and velocities.

    The residual momentum is brought up to date first and kept: it belongs to the time before. Where that time
    does not count, because grains have been put back (`anew`), it is cleared.
    """
    for number in range(ROUNDS + 1):
        run_spin_up_round(replica, number, int(anew), world, coupling)
