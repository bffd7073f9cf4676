"""Deposit: sums over the grains of each cell of air, per part of the grains, in buffers of its own.

Parts are partitions, or chunks of equally many grains where one thread advances one grain. No two threads
add to the same number, and parts are summed in their order, so that the bits repeat.
"""

from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.gather import SPHERE_VOLUME
from taichi_erosion.coupling.weights import column_share, layer_range, share_below, wind_of
from taichi_erosion.grains.cells import position_of
from taichi_erosion.grains.state import partition_first, side_block

real = ti.f64


@ti.func
def buffer_row(world: ti.template(), r, p):
    return p * world.replicas.count + r


@ti.func
def part_count(world: ti.template(), coupling: ti.template(), r):
    """Parts in which the grains of replica r are summed."""
    count = world.replicas.partitions[r]
    if ti.static(coupling.sums.chunk > 0):
        count = ti.max((world.replicas.released[r] - 1) // coupling.sums.chunk, 0) + 1
    return count


@ti.func
def part_first(world: ti.template(), coupling: ti.template(), r, p):
    """First rank of part p of replica r; of the part behind the last, one past all grains."""
    first = 0
    if ti.static(coupling.sums.chunk > 0):
        first = ti.min(p * coupling.sums.chunk, world.replicas.released[r])
    else:
        first = partition_first(world.replicas, r, p)
    return first


@ti.func
def exchange_interval(world: ti.template(), coupling: ti.template(), r):
    """Time from one exchange to the next [s]."""
    return ti.cast(world.replicas.time_step[r], real) * coupling.exchange.look_steps[r]


@ti.func
def implicit_rate(world: ti.template(), r, rate):
    """Rate at which frozen drag of this rate acts through the implicit steps of a grain [s-1]."""
    return rate / (1.0 + rate * ti.cast(world.replicas.time_step[r], real))


@ti.func
def mean_wind(air: ti.template(), r, position, radius):
    """Mean velocity of the air over the volume of a sphere [m s-1]."""
    first, last = layer_range(air, r, position[2], radius)
    mean = ti.Vector([real(0.0), real(0.0), real(0.0)])
    for corner in range(air.columns_per_grain):
        column, across = column_share(air, r, position, corner)
        below = real(0.0)
        for k in range(first, last + 1):
            above = ti.select(k == last, real(1.0), share_below(air, r, position[2], radius, k + 1))
            mean += across * (above - below) * wind_of(air, r, column, k)
            below = above
    return mean


@ti.func
def air_cell_index(air: ti.template(), column, k):
    """Number of a cell among those of its replica."""
    return (column[0] * air.cells[1] + column[1]) * air.cells[2] + k


@ti.func
def deposit_share(sums_out: ti.template(), row, cell, share, volume, mass, rate, velocity, gain):
    """Add the share of one grain to a cell; `gain` is its change of velocity by that cell [m s-1]."""
    part = share * mass
    sums_out.volume[row, cell] = sums_out.volume[row, cell] + share * volume
    sums_out.rate[row, cell] = sums_out.rate[row, cell] + part * rate
    sums_out.drag_source[row, cell] = sums_out.drag_source[row, cell] + part * rate * velocity
    sums_out.impulse[row, cell] = sums_out.impulse[row, cell] + part * gain
    sums_out.volume_flow[row, cell] = sums_out.volume_flow[row, cell] + share * volume * velocity[2]


@ti.func
def deposit_grain(world_out: ti.template(), coupling_out: ti.template(), r, row, i):
    """Deposit the grain at place i in its cells."""
    grains, frozen_out = ti.static((world_out.grains, world_out.frozen_drag))
    sums_out, air = ti.static((coupling_out.sums, coupling_out.air))
    radius = ti.cast(grains.radius[i], real)
    position = position_of(grains, world_out.replicas, r, i)
    mass, velocity = 1.0 / ti.cast(grains.mass_inverse[i], real), ti.cast(grains.velocity[i], real)
    rate = implicit_rate(world_out, r, ti.cast(frozen_out.drag_rate[i], real))
    drag_kick = ti.cast(frozen_out.drag_kick[i], real)
    kick = rate * exchange_interval(world_out, coupling_out, r)
    volume = SPHERE_VOLUME * radius**3
    mean = mean_wind(air, r, position, radius)
    first, last = layer_range(air, r, position[2], radius)
    for corner in range(air.columns_per_grain):
        column, across = column_share(air, r, position, corner)
        below = real(0.0)
        for k in range(first, last + 1):
            above = ti.select(k == last, real(1.0), share_below(air, r, position[2], radius, k + 1))
            gain = drag_kick + kick * (wind_of(air, r, column, k) - mean)
            cell = air_cell_index(air, column, k)
            deposit_share(sums_out, row, cell, across * (above - below), volume, mass, rate, velocity, gain)
            below = above
    frozen_out.drag_kick[i] = 0.0 * frozen_out.drag_kick[i]


@ti.func
def deposit_part(world_out: ti.template(), coupling_out: ti.template(), r, p):
    """Sums of the grains of one part, cell by cell."""
    (sums_out,) = ti.static((coupling_out.sums,))
    row = buffer_row(world_out, r, p)
    for c in range(coupling_out.air.cell_count):
        sums_out.volume[row, c] = 0.0
        sums_out.rate[row, c] = 0.0
        sums_out.volume_flow[row, c] = 0.0
        sums_out.drag_source[row, c] = 0.0 * sums_out.drag_source[row, c]
        sums_out.impulse[row, c] = 0.0 * sums_out.impulse[row, c]
    (replicas,) = ti.static((world_out.replicas,))
    base = side_block(world_out.grains, r, replicas.side[r])
    first = part_first(world_out, coupling_out, r, p)
    for rank in range(first, part_first(world_out, coupling_out, r, p + 1)):
        deposit_grain(world_out, coupling_out, r, row, base + rank)
