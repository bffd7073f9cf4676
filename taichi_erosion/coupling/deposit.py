"""What grains hand to the cells of the air at a look: sums of every partition, in buffers of its own."""

from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.gather import SPHERE_VOLUME
from taichi_erosion.coupling.weights import column_share, layer_range, share_below, wind_of
from taichi_erosion.grains.cells import position_of
from taichi_erosion.grains.state import partition_first, side_block

real = ti.f64


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
def mean_wind(air: ti.template(), r, position, radius):
    """Mean velocity of the air over the volume of a sphere [m s-1]."""
    first, last = layer_range(air, r, position[2], radius)
    mean = ti.Vector([real(0.0), real(0.0), real(0.0)])
    for sharer in range(air.sharers):
        column, across = column_share(air, r, position, sharer)
        below = real(0.0)
        for k in range(first, last + 1):
            above = ti.select(k == last, real(1.0), share_below(air, r, position[2], radius, k + 1))
            mean += across * (above - below) * wind_of(air, r, column, k)
            below = above
    return mean


@ti.func
def cell_number(air: ti.template(), column, k):
    """Number of a cell among those of its replica."""
    return (column[0] * air.cells[1] + column[1]) * air.cells[2] + k


@ti.func
def give(sums_out: ti.template(), row, cell, share, grain, dragged):
    """Add the share of one grain, (volume, mass, rate, velocity), and what it got from a cell."""
    volume, mass, rate, velocity = grain
    part = share * mass
    sums_out.volume[row, cell] = sums_out.volume[row, cell] + share * volume
    sums_out.rate[row, cell] = sums_out.rate[row, cell] + part * rate
    sums_out.pull[row, cell] = sums_out.pull[row, cell] + part * rate * velocity
    sums_out.given[row, cell] = sums_out.given[row, cell] + part * dragged
    sums_out.flow[row, cell] = sums_out.flow[row, cell] + share * volume * velocity[2]


@ti.func
def give_grain(world_out: ti.template(), around_out: ti.template(), r, row, i):
    """Hand what the grain at place i holds to its cells."""
    grains, held_out, air = ti.static((world_out.grains, world_out.held, around_out.air))
    radius = ti.cast(grains.radius[i], real)
    position = position_of(grains, world_out.replicas, r, i)
    mass, velocity = 1.0 / ti.cast(grains.mass_inverse[i], real), ti.cast(grains.velocity[i], real)
    rate = passed_rate(world_out, r, ti.cast(held_out.drift_rate[i], real))
    dragged = ti.cast(held_out.dragged[i], real)
    kick = rate * look_interval(world_out, around_out, r)
    grain = (SPHERE_VOLUME * radius**3, mass, rate, velocity)
    mean = mean_wind(air, r, position, radius)
    first, last = layer_range(air, r, position[2], radius)
    for sharer in range(air.sharers):
        column, across = column_share(air, r, position, sharer)
        below = real(0.0)
        for k in range(first, last + 1):
            above = ti.select(k == last, real(1.0), share_below(air, r, position[2], radius, k + 1))
            got = dragged + kick * (wind_of(air, r, column, k) - mean)
            give(around_out.sums, row, cell_number(air, column, k), across * (above - below), grain, got)
            below = above
    held_out.dragged[i] = 0.0 * held_out.dragged[i]


@ti.func
def give_partition(world_out: ti.template(), around_out: ti.template(), r, p):
    """Sums of the grains of one partition, cell by cell."""
    (sums_out,) = ti.static((around_out.sums,))
    row = buffer_row(world_out, r, p)
    for c in range(around_out.air.cell_count):
        sums_out.volume[row, c] = 0.0
        sums_out.rate[row, c] = 0.0
        sums_out.flow[row, c] = 0.0
        sums_out.pull[row, c] = 0.0 * sums_out.pull[row, c]
        sums_out.given[row, c] = 0.0 * sums_out.given[row, c]
    (replicas,) = ti.static((world_out.replicas,))
    base = side_block(world_out.grains, r, replicas.side[r])
    for rank in range(partition_first(replicas, r, p), partition_first(replicas, r, p + 1)):
        give_grain(world_out, around_out, r, row, base + rank)
