"""Cells: grains are sorted in space, so that neighbours in space are neighbours in memory.

A box is divided into cells at least as wide as the longest list distance (`simulation/upload.py`). Grains
outside belong to the border cells, which keeps every pair of close grains in the same or in adjacent
cells. Cells are numbered along the axis with the fewest of them first and along the one with the most
last: layers of cells are small, and grains in contact lie near in memory. The box follows the grains from
rebuild to rebuild; under wind, where some fly far above a bed, it is that of the scene.
"""

from typing import Any

import numpy as np

from taichi_erosion.core.setup import Floats, PrimitiveKind, Setup
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record
from taichi_erosion.grains.state import arrays, side_start

SPREAD = 2.0  # half width of the box over the standard deviation of the grains' positions [1]; few lie beyond
WIDER = 1.1  # factor on the width of cells while they are too many [1]
GONE = -1  # cell of a grain that is taken out
PERIOD_CELLS_LEAST = 3  # with fewer cells along a period a pair would be found twice


@device_record
class Cells:
    """Cell grids of all replicas and the order of grains in them."""

    capacity: int  # cells a replica
    most: Any  # i32 by replica, cells
    width_least: Any  # f64 by replica [m]
    low: Any  # f64 vec3 by replica, corner of the grid [m]
    inverse_width: Any  # f64 vec3 by replica [m-1]
    number: Any  # i32 vec3 by replica, cells along each axis
    axes: Any  # i32 vec3 by replica, axes of the box, the one with fewest cells first
    first: Any  # i32, rank of each first grain: by `first_cell_place` + cell + 1, see `first_rank_of_cell`
    cell: Any  # i32 by grain place of one side: cell of the grain, by rank before the sort
    order: Any  # i32 by grain place of one side: rank before the sort, by rank after it


def allocate_cells(replicas: int, grains: int, capacity: int) -> Cells:
    table = arrays(replicas, i32="most", f64="width_least", f64x3="low inverse_width", i32x3="number axes")
    first = arrays(replicas * (capacity + 2), i32="first")
    return Cells(capacity, **table, **first, **arrays(replicas * grains, i32="cell order"))


@ti.func
def first_cell_place(cells: ti.template(), r):
    """First place of replica r in `first`: two places more than cells, to shift the sort and to close it."""
    return r * (cells.capacity + 2)


@ti.func
def wrap(position, period, low):
    """Position moved into its period [m]; where the period is 0 the box is open."""
    inside = position
    for k in ti.static(range(3)):
        if period[k] > 0.0:
            inside[k] -= period[k] * ti.floor((position[k] - low[k]) / period[k])
    return inside


@ti.func
def nearest_image_distances(away, period):
    """Distances along the axes between nearest images of two wrapped positions [m]."""
    nearest = away
    for k in ti.static(range(3)):
        if period[k] > 0.0:
            nearest[k] = ti.min(away[k], period[k] - away[k])
    return nearest


@ti.func
def arrange_along_axes(cells: ti.template(), r, along):
    """Components of a vector in the order of the axes of replica r."""
    axes = cells.axes[r]
    return ti.Vector([along[axes[0]], along[axes[1]], along[axes[2]]])


@ti.func
def order_axes_by_cells(cells_out: ti.template(), r):
    """Order the axes of replica r by their number of cells; equal ones keep the order x, y, z."""
    number = cells_out.number[r]
    for axis in ti.static(range(3)):
        rank = 0
        for other in ti.static(range(3)):
            before = number[other] < number[axis]
            if ti.static(other < axis):
                before = number[other] <= number[axis]
            rank += ti.cast(before, ti.i32)
        cells_out.axes[r][rank] = axis


@ti.func
def cell_coordinates(cells: ti.template(), r, position):
    """Integer coordinates along the arranged axes of the cell that holds a position, clamped to the grid."""
    place = ti.floor((position - cells.low[r]) * cells.inverse_width[r], ti.i32)
    return arrange_along_axes(cells, r, ti.math.clamp(place, 0, cells.number[r] - 1))


@ti.func
def cells_within(cells: ti.template(), replicas: ti.template(), r, position, distance):
    """First cell and number of cells, along the arranged axes, of a box around a wrapped position.

    Behind the last cell of a period its first follows; elsewhere the box ends at the grid.
    """
    number, periodic = cells.number[r], replicas.period[r] > 0.0
    low = ti.floor((position - distance - cells.low[r]) * cells.inverse_width[r], ti.i32)
    high = ti.floor((position + distance - cells.low[r]) * cells.inverse_width[r], ti.i32)
    first = ti.select(periodic, low % number, ti.math.clamp(low, 0, number - 1))
    count = ti.select(
        periodic, ti.min(high - low + 1, number), ti.math.clamp(high, 0, number - 1) - first + 1
    )
    return arrange_along_axes(cells, r, first), arrange_along_axes(cells, r, count)


@ti.func
def cell_of_run(first, beyond, k):
    """Cell k, in rising order, of a run from `first` on with `beyond` cells at the beginning of a period."""
    return k + ti.select(k < beyond, 0, first - beyond)


@ti.func
def cell_index(number, place):
    """Number of the cell at `place` in a grid of `number` cells, both along the arranged axes."""
    return (place[2] * number[1] + place[1]) * number[0] + place[0]


@ti.func
def wrapped_position(grains: ti.template(), replicas: ti.template(), r, i):
    """Position of the grain at place i [m], in f64, wrapped into the period."""
    position = grains.origin[i] + ti.cast(grains.shift[i], ti.f64)
    return wrap(position, replicas.period[r], replicas.low[r])


@ti.func
def box_and_position_sums(grains: ti.template(), replicas: ti.template(), r, begin, end):
    """Corners of the box around the grains of ranks begin to end [m], and sums for `box_of_most_grains`."""
    base = side_start(grains, r, replicas.side[r])
    low = replicas.high[r]
    high = replicas.low[r]
    total, squares = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
    for i in range(base + begin, base + end):
        place = grains.origin[i] + ti.cast(grains.shift[i], ti.f64)
        low, high = ti.min(low, place), ti.max(high, place)
        total += place
        squares += place * place
    return low, high, total, squares


@ti.func
def box_of_most_grains(replicas: ti.template(), r, low, high, total, squares):
    """Low and high corner of the box around most grains of replica r [m]; along a period, the period."""
    count = replicas.released[r]
    mean = total / ti.max(count, 1)
    spread = SPREAD * ti.sqrt(ti.max(squares / ti.max(count, 1) - mean * mean, 0.0))
    lowest, highest = ti.max(low, mean - spread), ti.min(high, mean + spread)
    for k in ti.static(range(3)):
        if replicas.period[r][k] > 0.0:
            lowest[k] = replicas.low[r][k]
            highest[k] = lowest[k] + replicas.period[r][k]
    return lowest, highest


@ti.func
def fit_grid_to_grains(cells_out: ti.template(), grains: ti.template(), replicas: ti.template(), r):
    low, high, total, squares = box_and_position_sums(grains, replicas, r, 0, replicas.released[r])
    low, high = box_of_most_grains(replicas, r, low, high, total, squares)
    divide_box_into_cells(cells_out, replicas, r, low, high)


@ti.func
def divide_box_into_cells(cells_out: ti.template(), replicas: ti.template(), r, low, high):
    """Grid of replica r in a box; cells are widened while they are too many."""
    width = cells_out.width_least[r]
    span = ti.max(high - low, width)
    fewest = ti.select(replicas.period[r] > 0.0, float(PERIOD_CELLS_LEAST), 1.0)
    number = ti.max(ti.floor(span / width), fewest)
    while number[0] * number[1] * number[2] > cells_out.most[r]:
        width *= WIDER
        number = ti.max(ti.floor(span / width), fewest)
    cells_out.low[r] = low
    cells_out.inverse_width[r] = number / span
    cells_out.number[r] = ti.cast(number, ti.i32)


@ti.func
def cell_of_grain(cells: ti.template(), grains: ti.template(), replicas: ti.template(), r, i):
    place = cell_coordinates(cells, r, wrapped_position(grains, replicas, r, i))
    return cell_index(arrange_along_axes(cells, r, cells.number[r]), place)


@ti.func
def sort_grains_by_cell(cells_out: ti.template(), grains: ti.template(), replicas: ti.template(), r):
    """Counting sort of replica r by cell, stable, by one worker: the order never depends on scheduling.

    Grains that are taken out, whose cell is GONE, get no rank.
    """
    count = replicas.released[r]
    base = side_start(grains, r, replicas.side[r])
    row = r * grains.capacity
    first = first_cell_place(cells_out, r)
    order_axes_by_cells(cells_out, r)
    number = arrange_along_axes(cells_out, r, cells_out.number[r])
    total = number[0] * number[1] * number[2]
    for c in range(total + 1):
        cells_out.first[first + c] = 0
    for i in range(count):
        if replicas.leaving[r] == 0 or cells_out.cell[row + i] != GONE:
            c = cell_of_grain(cells_out, grains, replicas, r, base + i)
            cells_out.cell[row + i] = c
            cells_out.first[first + c + 1] = cells_out.first[first + c + 1] + 1
    for c in range(total):
        cells_out.first[first + c + 1] = cells_out.first[first + c + 1] + cells_out.first[first + c]
    for k in range(count):
        # backwards, so that filling a cell from its end keeps the old order and leaves `first` one cell early
        i = count - 1 - k
        c = cells_out.cell[row + i]
        if c != GONE:
            rank = cells_out.first[first + c + 1] - 1
            cells_out.first[first + c + 1] = rank
            cells_out.order[row + rank] = i
    cells_out.first[first + total + 1] = count - replicas.leaving[r]


@ti.func
def first_rank_of_cell(cells: ti.template(), r, c):
    """Rank of the first grain in cell c; after the sort the bounds lie one place on."""
    return cells.first[first_cell_place(cells, r) + c + 1]


def cell_grid(setup: Setup, least: float, most: int) -> dict[str, Any]:
    """Members of Cells of one replica: around everything the scene names, not narrower than `least` [m].

    That is the longest list distance. Where it makes more than `most`, they are widened; grains outside the
    box belong to its border cells.
    """
    low, high = scene_box(setup)
    span = np.maximum(high - low, least)
    width = least
    while np.prod(np.maximum(np.floor(span / width), 1.0)) > most:
        width *= WIDER
    number = np.maximum(np.floor(span / width), 1.0)
    return {"most": most, "width_least": least, "low": low, "inverse_width": number / span, "number": number}


def scene_box(setup: Setup) -> tuple[Floats, Floats]:
    """Box around grains and finite walls [m]; along a period, the period itself."""
    points = [setup.grains.position]
    shape = setup.primitives.shape
    for kind, row in zip(setup.primitives.kind, shape, strict=True):
        if kind == PrimitiveKind.TRIANGLE:
            points.append(row[:9].reshape(3, 3))
        elif kind == PrimitiveKind.REVOLVED:
            ends = row[:3] + np.outer(row[[7, 9]], row[3:6])
            largest = max(row[6], row[8])
            points.extend([ends - largest, ends + largest])
    stacked = np.concatenate(points)
    low, high = np.nanmin(stacked, axis=0), np.nanmax(stacked, axis=0)
    period = np.asarray(setup.period)
    start = np.asarray(setup.domain[0])
    return np.where(period > 0, start, low), np.where(period > 0, start + period, high)
