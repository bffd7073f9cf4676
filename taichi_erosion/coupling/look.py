"""The look: grains hand the air what they took from it, the air moves on, and the grains feel it anew.

Between two looks the drag on a grain is held as a rate b towards a velocity (`grains.held`). At a look

    1  every layer sums up volume, m b and m b v of its grains, and the momentum P that drag has given them;
    2  P settles part of what is `owed`: momentum that the air has lost and its grains have not yet got;
    3  the air advances with the drag  -sum m b (u - v)  taken implicitly, so no rate is too fast for it, and
       gets back what is owed, spread over the step dt. What it then loses is owed anew. Over any time, what
       the air lost is what the grains got plus what is owed, to rounding;
    4  every grain receives the mean velocity of its layers and all other forces.

In 1 to 3 b stands for b / (1 + b h), which is what the grains' own implicit steps h pass on. A grain that its
contacts hold then takes in n steps just what the air gives, and a free one less: the difference u - v shrinks
at any rate, and never changes its sign. The first of all looks is taken twice, at first without 3: grains and
air must know each other before they exchange anything.

A grain that reaches through several layers takes more from the faster ones: of its momentum p, the layer k
with velocity u_k and a share s_k of the grain gives  s_k (p + m b dt (u_k - sum s_l u_l)),  all layers p.
Giving s_k p would drag the air between the grains backwards.

Vertical momentum of a column is carried by the pressure. Where air rises through the bed with the superficial
velocity W, continuity and the balance of drag and pressure give, layer by layer,

    w = (W - sum V v_z / V_cell) / eps,    -dp/dz = sum m b (w - v_z) / (V_cell eps).
"""

from taichi_erosion.air.column import advance_column
from taichi_erosion.air.place import cell_volume
from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.feel import SPHERE_VOLUME, feel_partition
from taichi_erosion.coupling.slices import layer_range, share_below
from taichi_erosion.grains.cells import position_of
from taichi_erosion.grains.sleep import lull
from taichi_erosion.grains.state import partition_first, side_block
from taichi_erosion.grains.team import is_mine, wait_for_team

real = ti.f64

VOID_LEAST = 0.05  # of a layer that grains of one height fill: keeps velocities between grains finite [1]


@ti.func
def buffer_row(world: ti.template(), r, p):
    """Row of the buffers of partition p."""
    return p * world.replicas.count + r


@ti.func
def look_interval(world: ti.template(), around: ti.template(), r):
    """Time from one look to the next [s]."""
    return ti.cast(world.replicas.time_step[r], real) * around.exchange.look_steps[r]


@ti.func
def passed_rate(world: ti.template(), r, rate):
    """Rate at which drag held at `rate` acts through the implicit steps of a grain [s-1]."""
    return rate / (1.0 + rate * ti.cast(world.replicas.time_step[r], real))


@ti.func
def wind_of(air: ti.template(), r, k):
    """Velocity of layer k [m s-1]."""
    return ti.Vector([air.velocity_x[r, 0, 0, k], air.velocity_y[r, 0, 0, k], real(0.0)])


@ti.func
def mean_wind(air: ti.template(), r, height, radius):
    """Mean velocity of the air over the volume of a sphere [m s-1]."""
    first, last = layer_range(air, r, height, radius)
    mean, below = ti.Vector([real(0.0), real(0.0), real(0.0)]), real(0.0)
    for k in range(first, last + 1):
        above = ti.select(k == last, real(1.0), share_below(air, r, height, radius, k + 1))
        mean += (above - below) * wind_of(air, r, k)
        below = above
    return mean


@ti.func
def give(layers_out: ti.template(), row, k, share, grain, dragged):
    """Add the share of one grain, (volume, mass, rate, velocity), and what it got from layer k."""
    volume, mass, rate, velocity = grain
    part = share * mass
    layers_out.volume[row, k] = layers_out.volume[row, k] + share * volume
    layers_out.rate[row, k] = layers_out.rate[row, k] + part * rate
    layers_out.pull[row, k] = layers_out.pull[row, k] + part * rate * velocity
    layers_out.given[row, k] = layers_out.given[row, k] + part * dragged
    layers_out.flow[row, k] = layers_out.flow[row, k] + share * volume * velocity[2]


@ti.func
def give_grain(world_out: ti.template(), around_out: ti.template(), r, row, i):
    """Hand what the grain at place i holds to its layers."""
    grains, held_out, air = ti.static((world_out.grains, world_out.held, around_out.air))
    radius = ti.cast(grains.radius[i], real)
    height = position_of(grains, world_out.replicas, r, i)[2]
    mass, velocity = 1.0 / ti.cast(grains.mass_inverse[i], real), ti.cast(grains.velocity[i], real)
    rate = passed_rate(world_out, r, ti.cast(held_out.drift_rate[i], real))
    dragged = ti.cast(held_out.dragged[i], real)
    kick = rate * look_interval(world_out, around_out, r)
    grain = (SPHERE_VOLUME * radius**3, mass, rate, velocity)
    mean = mean_wind(air, r, height, radius)
    first, last = layer_range(air, r, height, radius)
    below = real(0.0)
    for k in range(first, last + 1):
        above = ti.select(k == last, real(1.0), share_below(air, r, height, radius, k + 1))
        got = dragged + kick * (wind_of(air, r, k) - mean)
        give(around_out.layers, row, k, above - below, grain, got)
        below = above
    held_out.dragged[i] = 0.0 * held_out.dragged[i]


@ti.func
def give_partition(world_out: ti.template(), around_out: ti.template(), r, p):
    """Sums of the grains of one partition, layer by layer."""
    (layers_out,) = ti.static((around_out.layers,))
    row = buffer_row(world_out, r, p)
    for k in range(around_out.air.cells[2]):
        layers_out.volume[row, k] = 0.0
        layers_out.rate[row, k] = 0.0
        layers_out.flow[row, k] = 0.0
        layers_out.pull[row, k] = 0.0 * layers_out.pull[row, k]
        layers_out.given[row, k] = 0.0 * layers_out.given[row, k]
    (replicas,) = ti.static((world_out.replicas,))
    base = side_block(world_out.grains, r, replicas.side[r])
    for rank in range(partition_first(replicas, r, p), partition_first(replicas, r, p + 1)):
        give_grain(world_out, around_out, r, row, base + rank)


@ti.func
def collect_layer(world: ti.template(), around: ti.template(), r, k):
    """Volume, rate, pull and vertical flow of all grains in layer k."""
    (layers,) = ti.static((around.layers,))
    row = buffer_row(world, r, 0)
    volume, rate, flow = layers.volume[row, k], layers.rate[row, k], layers.flow[row, k]
    pull = layers.pull[row, k]
    for p in range(1, world.replicas.partitions[r]):
        row = buffer_row(world, r, p)
        volume += layers.volume[row, k]
        rate += layers.rate[row, k]
        flow += layers.flow[row, k]
        pull += layers.pull[row, k]
    return volume, rate, pull, flow


@ti.func
def along_layer(momentum):
    """The horizontal part: vertical momentum is the pressure's."""
    return ti.Vector([momentum[0], momentum[1], real(0.0)])


@ti.func
def settle(world: ti.template(), around_out: ti.template(), r):
    """Take what the grains have got off what is owed to them."""
    layers, exchange_out = ti.static((around_out.layers, around_out.exchange))
    for k in range(around_out.air.cells[2]):
        for p in range(world.replicas.partitions[r]):
            given = layers.given[buffer_row(world, r, p), k]
            exchange_out.owed[r, k] = exchange_out.owed[r, k] - along_layer(given)


@ti.func
def load_air(world: ti.template(), around_out: ti.template(), r):
    """Write void fraction and exchange of every layer for the coming steps of the air."""
    air_out, exchange_out = ti.static((around_out.air, around_out.exchange))
    for k in range(air_out.cells[2]):
        volume, rate, pull, flow = collect_layer(world, around_out, r, k)
        cell = cell_volume(air_out, r, k)
        void = ti.max(1.0 - volume / cell, VOID_LEAST)
        air_out.void_fraction[r, 0, 0, k] = void
        air_out.exchange_coefficient[r, 0, 0, k] = rate / cell
        air_out.exchange_force[r, 0, 0, k] = pull / cell
        if ti.static(around_out.rising):
            rise = (exchange_out.through_flow[r] - flow / cell) / void
            exchange_out.rise[r, k] = rise
            exchange_out.lift[r, k] = (rate * rise - pull[2]) / (cell * void)


@ti.func
def drag_on_air(air: ti.template(), r, k):
    """Force of the grains on a layer of air [N m-3]."""
    force = along_layer(air.exchange_force[r, 0, 0, k])
    return force - air.exchange_coefficient[r, 0, 0, k] * wind_of(air, r, k)


@ti.func
def advance_air(world: ti.template(), around_out: ti.template(), r):
    """Let the air of replica r move on until the next look."""
    air_out, exchange_out = ti.static((around_out.air, around_out.exchange))
    interval = look_interval(world, around_out, r)
    for k in range(air_out.cells[2]):
        back = exchange_out.owed[r, k] / (interval * cell_volume(air_out, r, k))
        air_out.exchange_force[r, 0, 0, k] = air_out.exchange_force[r, 0, 0, k] + back
    advance_column(air_out, r, interval)
    for k in range(air_out.cells[2]):
        gained = drag_on_air(air_out, r, k) * (interval * cell_volume(air_out, r, k))
        exchange_out.owed[r, k] = exchange_out.owed[r, k] - gained


@ti.func
def exchange(world_out: ti.template(), around_out: ti.template(), r, member, size, turn, advances):
    """Sum up the grains, layer by layer, and let the air move on where it `advances`; the next meeting."""
    (replicas_out,) = ti.static((world_out.replicas,))
    for p in range(replicas_out.partitions[r]):
        if is_mine(replicas_out, r, p, member, size):
            give_partition(world_out, around_out, r, p)
    turn = wait_for_team(replicas_out, r, size, turn)
    if member == 0:
        settle(world_out, around_out, r)
        load_air(world_out, around_out, r)
        if advances:
            advance_air(world_out, around_out, r)
    return wait_for_team(replicas_out, r, size, turn)


@ti.func
def look(world_out: ti.template(), around_out: ti.template(), r, member, size, turn):
    """One look of all grains of replica r; returns the next meeting of the team."""
    (replicas_out,) = ti.static((world_out.replicas,))
    before = ti.select(replicas_out.step[r] == 0, 1, 0)
    for passage in range(before + 1):
        if ti.static(around_out.windy):
            turn = exchange(world_out, around_out, r, member, size, turn, passage == before)
        for p in range(replicas_out.partitions[r]):
            if is_mine(replicas_out, r, p, member, size):
                feel_partition(world_out, around_out, r, p, passage == before)
    if ti.static(world_out.remembers):
        # forces read what is remembered of grains of other partitions
        turn = wait_for_team(replicas_out, r, size, turn)
    if ti.static(world_out.sleeps):
        turn = lull(world_out, r, member, size, turn)
    return turn
