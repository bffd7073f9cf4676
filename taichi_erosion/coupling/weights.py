"""Interpolation weights: shares of a sphere in the cells of air. Layers are thinner than grains.

The share of a sphere's volume below a height s (in radii, from its centre) is

    c(s) = (2 + 3 s - s^3) / 4,    -1 <= s <= 1,

and the shares of all layers add up to one exactly, because each is the difference of two neighbouring c and
the outermost ones are set to 0 and 1. What reaches below the floor or above the lid counts in the outermost
layer. Columns of cells are wider than grains: the four whose middles lie around the centre of a grain have
bilinear weights along x and y, periodic. Gather and deposit use the same weights, so that the drag on a grain
is the sum of what its cells lose.
"""

from taichi_erosion.air.grid import cell_velocity, layer_of
from taichi_erosion.core.ti import ti

real = ti.f64


@ti.func
def share_below(air: ti.template(), r, height, radius, face):
    """Share of the sphere below the face with this number [1]."""
    share = real(1.0)
    if face < air.cells[2]:
        s = ti.min(ti.max((air.face[r, face] - height) / radius, -1.0), 1.0)
        share = 0.25 * (2.0 + 3.0 * s - s * s * s)
    return share


@ti.func
def layer_range(air: ti.template(), r, height, radius):
    """First and last layer that a sphere reaches."""
    return layer_of(air, r, height - radius), layer_of(air, r, height + radius)


@ti.func
def share_along(air: ti.template(), r, axis: ti.template(), x, upper):
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
        i, along = share_along(air, r, 0, position[0], corner // 2)
        j, across = share_along(air, r, 1, position[1], corner % 2)
        column, share = ti.Vector([i, j]), along * across
    return column, share


@ti.func
def wind_of(air: ti.template(), r, column, k):
    """Velocity of the air in a cell [m s-1]; in a single column it is horizontal."""
    i, j = column[0], column[1]
    wind = ti.Vector([air.velocity_x[r, i, j, k], air.velocity_y[r, i, j, k], real(0.0)])
    if ti.static(not air.is_column):
        wind = cell_velocity(air, r, i, j, k)
    return wind
