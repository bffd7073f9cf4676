"""Searching the partners of a grain: in adjacent cells, and for a few wide grains among all others."""

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.cells import arranged, cell_coordinates, cell_index, cell_start, shortest_way
from taichi_erosion.grains.margins import is_wide
from taichi_erosion.grains.state import side_block

ROWS = 5  # rows of cells that follow a cell: the rest of its own row, one beside it, three above


@ti.func
def closeness(world: ti.template(), r, i, j, period):
    """How places i and j stand: 0 far apart, 1 may touch before the next rebuild, 2 touching."""
    (grains,) = ti.static((world.grains,))
    within = grains.extent[i] + grains.extent[j] + world.replicas.reach[r]
    away = shortest_way(ti.abs(grains.origin[i] - grains.origin[j]), period)
    distance_squared = ti.cast(away.norm_sqr(), float)
    stand = 0
    if distance_squared < within * within:
        contact_distance = grains.radius[i] + grains.radius[j]
        stand = 1 + ti.cast(distance_squared < contact_distance * contact_distance, ti.i32)
    if ti.static(world.clumped):
        row = r * grains.capacity
        if world.source.body[row + grains.ident[i]] == world.source.body[row + grains.ident[j]]:
            stand = 0
    return stand


@ti.func
def row_piece(cells: ti.template(), grid, r, place, row, piece):
    """Ranks [first, last) of one run of cells in row `row` after the cell `place`; empty outside the grid.

    `grid` is (number of cells, whether periodic), and x, y, z here are the arranged axes. Piece 0 is the run
    inside the grid, piece 1 the one cell beyond a periodic edge in x.
    """
    number, periodic = grid
    y = place[1] + (row == 1) + (row >= 2) * (row - 3)
    z = place[2] + (row >= 2)
    if periodic[1] == 1:
        y = (y + number[1]) % number[1]
    if periodic[2] == 1:
        z = z % number[2]
    left = ti.max(place[0] - (row > 0), 0)
    right = ti.min(place[0] + 1, number[0] - 1)
    if piece == 1:
        left = ti.select(place[0] == 0, number[0] - 1, 0)
        right = left
    wanted = piece == 0 or (periodic[0] == 1 and ((place[0] == 0 and row > 0) or place[0] == number[0] - 1))
    first = 0
    last = 0
    if wanted and 0 <= y < number[1] and z < number[2]:
        first = cell_start(cells, r, cell_index(number, (left, y, z)))
        last = cell_start(cells, r, cell_index(number, (right, y, z)) + 1)
    return first, last


@ti.func
def list_partner(world_out: ti.template(), entry, limit, found, j, stand):
    """Write partner j behind those `found`, (wanted, touching), and return both numbers; touching ones first.

    Nothing is written from `limit` on; a number beyond it tells the host to grow the list.
    """
    (pairs_out,) = ti.static((world_out.pairs,))
    wanted, touching = found
    if stand > 0:
        if entry + wanted < limit:
            slot = entry + wanted
            if stand == 2:
                pairs_out.neighbour[slot] = pairs_out.neighbour[entry + touching]
                slot = entry + touching
                touching += 1
            pairs_out.neighbour[slot] = j
        wanted += 1
    return wanted, touching


@ti.func
def search_cells(world_out: ti.template(), r, rank, entry, limit):
    """List the partners of one grain in its own and adjacent cells; wide ones list it themselves."""
    (cells,) = ti.static((world_out.cells,))
    base = side_block(world_out.grains, r, 1 - world_out.replicas.side[r])
    place = cell_coordinates(cells, r, world_out.grains.origin[base + rank])
    period = world_out.replicas.period[r]
    periodic = arranged(cells, r, ti.cast(period > 0.0, ti.i32))
    grid = (arranged(cells, r, cells.number[r]), periodic)
    wanted, touching = 0, 0
    for run in range(2 * ROWS):
        first, last = row_piece(cells, grid, r, place, run // 2, run % 2)
        if run == 0:
            first = rank + 1
        for j in range(first, last):
            stand = closeness(world_out, r, base + rank, base + j, period)
            if stand > 0:
                if is_wide(world_out, r, base + j):
                    stand = 0
                wanted, touching = list_partner(world_out, entry, limit, (wanted, touching), j, stand)
    return wanted


@ti.func
def search_all(world_out: ti.template(), r, rank, entry, limit):
    """List the partners of a wide grain among all others; of two wide ones the first lists both."""
    (replicas,) = ti.static((world_out.replicas,))
    base = side_block(world_out.grains, r, 1 - replicas.side[r])
    period = replicas.period[r]
    wanted, touching = 0, 0
    for j in range(replicas.released[r]):
        stand = closeness(world_out, r, base + rank, base + j, period)
        if stand > 0:
            if j == rank or (j < rank and is_wide(world_out, r, base + j)):
                stand = 0
            wanted, touching = list_partner(world_out, entry, limit, (wanted, touching), j, stand)
    return wanted


@ti.func
def search_grain(world_out: ti.template(), r, rank, entry, limit):
    """List the partners of one grain from `entry` on; returns the number wanted."""
    base = side_block(world_out.grains, r, 1 - world_out.replicas.side[r])
    wanted = 0
    if is_wide(world_out, r, base + rank):
        wanted = search_all(world_out, r, rank, entry, limit)
    else:
        wanted = search_cells(world_out, r, rank, entry, limit)
    return wanted
