"""Deposit: sums over the grains of each cell of air, and the weights of a grain in its cells.

Layers are thinner than grains. The share of a sphere's volume below a height s (in radii, from its centre) is

    c(s) = (2 + 3 s - s^3) / 4,    -1 <= s <= 1,

and the shares of all layers add up to one exactly, because each is the difference of two neighbouring c and
the outermost ones are set to 0 and 1. What reaches below the floor or above the lid counts in the outermost
layer. Columns of cells are wider than grains: the four whose middles lie around the centre of a grain have
bilinear weights along x and y, periodic. Gather and deposit use the same weights, so that the drag on a grain
is the sum of what its cells lose.

Sums are kept by parts of the grains, in buffers of their own: partitions, or chunks of equally many grains
where one thread advances one grain. No two threads add to the same number, and parts are summed in their
order, so that the bits repeat.
"""

from math import pi

from taichi_erosion.air.grid import cell_velocity, layer_index
from taichi_erosion.core.ti import ti
from taichi_erosion.grains.cells import wrapped_position
from taichi_erosion.grains.state import side_start

real = ti.f64

SPHERE_VOLUME = 4.0 * pi / 3.0  # of radius 1 [1]


@ti.func
def share_below(air: ti.template(), r, height, radius, face):
    """Share of the sphere below the face with this number [1]."""
    share = real(1.0)
    if face < air.cells[2]:
        s = ti.min(ti.max((air.face[r, face] - height) / radius, -1.0), 1.0)
        share = 0.25 * (2.0 + 3.0 * s - s * s * s)
    return share


@ti.func
def sphere_layers(air: ti.template(), r, height, radius):
    """First and last layer that a sphere reaches."""
    return layer_index(air, r, height - radius), layer_index(air, r, height + radius)


@ti.func
def column_and_weight(air: ti.template(), r, axis: ti.template(), x, upper):
    """Index along x or y of one of the two columns around a coordinate [m], and its weight [1]."""
    place = (x - air.numbers.low[r][axis]) / air.numbers.width[r][axis] - 0.5
    base = ti.floor(place)
    share = ti.select(upper == 1, place - base, 1.0 - (place - base))
    count = ti.static(air.cells[axis])
    return (ti.cast(base, ti.i32) + upper + count) % count, share


@ti.func
def column_share(air: ti.template(), r, position, corner):
    """Indices (i, j) of one of the columns around a grain, and its weight [1]."""
    column, share = ti.Vector([0, 0]), real(1.0)
    if ti.static(not air.is_column):
        i, along = column_and_weight(air, r, 0, position[0], corner // 2)
        j, across = column_and_weight(air, r, 1, position[1], corner % 2)
        column, share = ti.Vector([i, j]), along * across
    return column, share


@ti.func
def cell_wind(air: ti.template(), r, column, k):
    """Velocity of the air in a cell [m s-1]; in a single column it is horizontal."""
    i, j = column[0], column[1]
    wind = ti.Vector([air.velocity_x[r, i, j, k], air.velocity_y[r, i, j, k], real(0.0)])
    if ti.static(not air.is_column):
        wind = cell_velocity(air, r, i, j, k)
    return wind


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
def first_rank_of_part(world: ti.template(), coupling: ti.template(), r, p):
    """First rank of part p of replica r; of the part behind the last, one past all grains."""
    first = 0
    if ti.static(coupling.sums.chunk > 0):
        first = ti.min(p * coupling.sums.chunk, world.replicas.released[r])
    else:
        first = world.replicas.bounds[r, p]
    return first


@ti.func
def exchange_interval(world: ti.template(), coupling: ti.template(), r):
    """Time from one exchange to the next [s]."""
    return ti.cast(world.replicas.time_step[r], real) * coupling.exchange.look_steps[r]


@ti.func
def implicit_drag_rate(world: ti.template(), r, rate):
    """Rate at which frozen drag of this rate acts through the implicit steps of a grain [s-1]."""
    return rate / (1.0 + rate * ti.cast(world.replicas.time_step[r], real))


@ti.func
def mean_wind_on_sphere(air: ti.template(), r, position, radius):
    """Mean velocity of the air over the volume of a sphere [m s-1]."""
    first, last = sphere_layers(air, r, position[2], radius)
    mean = ti.Vector([real(0.0), real(0.0), real(0.0)])
    for corner in range(air.columns_per_grain):
        column, across = column_share(air, r, position, corner)
        below = real(0.0)
        for k in range(first, last + 1):
            above = ti.select(k == last, real(1.0), share_below(air, r, position[2], radius, k + 1))
            mean += across * (above - below) * cell_wind(air, r, column, k)
            below = above
    return mean


@ti.func
def air_cell_index(air: ti.template(), column, k):
    """Number of a cell among those of its replica."""
    return (column[0] * air.cells[1] + column[1]) * air.cells[2] + k


@ti.func
def add_grain_share(sums_out: ti.template(), row, cell, share, volume, mass, rate, velocity, gain):
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
    position = wrapped_position(grains, world_out.replicas, r, i)
    mass, velocity = 1.0 / ti.cast(grains.mass_inverse[i], real), ti.cast(grains.velocity[i], real)
    rate = implicit_drag_rate(world_out, r, ti.cast(frozen_out.drag_rate[i], real))
    drag_kick = ti.cast(frozen_out.drag_kick[i], real)
    kick = rate * exchange_interval(world_out, coupling_out, r)
    volume = SPHERE_VOLUME * radius**3
    mean = mean_wind_on_sphere(air, r, position, radius)
    first, last = sphere_layers(air, r, position[2], radius)
    for corner in range(air.columns_per_grain):
        column, across = column_share(air, r, position, corner)
        below = real(0.0)
        for k in range(first, last + 1):
            above = ti.select(k == last, real(1.0), share_below(air, r, position[2], radius, k + 1))
            gain = drag_kick + kick * (cell_wind(air, r, column, k) - mean)
            cell = air_cell_index(air, column, k)
            add_grain_share(sums_out, row, cell, across * (above - below), volume, mass, rate, velocity, gain)
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
    base = side_start(world_out.grains, r, replicas.side[r])
    first = first_rank_of_part(world_out, coupling_out, r, p)
    for rank in range(first, first_rank_of_part(world_out, coupling_out, r, p + 1)):
        deposit_grain(world_out, coupling_out, r, row, base + rank)
