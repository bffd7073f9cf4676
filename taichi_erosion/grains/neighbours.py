"""Rebuilding the neighbour list: sort, move, search, and carry the memory of contacts over.

A grain may move by its own margin before the list is rebuilt: fast grains get a wide margin, resting grains a
narrow one, so that a few flying grains do not force the settled ones to search again. A pair is listed when

    |x_i - x_j| < R_i + R_j + h_i + h_j + reach,    h = clip(|v| t, m R, h_most),

and a rebuild is due as soon as any grain has moved by more than its h: no contact can be missed.
"""

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.cells import cell_coordinates, cell_index, cell_start, nearest_image, position_of
from taichi_erosion.grains.contact import ROLLING_INERTIA
from taichi_erosion.grains.held import clear_held, move_held
from taichi_erosion.grains.materials import pair_row
from taichi_erosion.grains.pairs import MEMORY, ROW_SHIFT, entry_block, partition_entries
from taichi_erosion.grains.state import partition_first, side_block

ROWS = 5  # rows of cells that follow a cell: the rest of its own row, one beside it, three above


@ti.func
def release_grains(world_out: ti.template(), r):
    """Append the grains whose time has come to the valid side, with empty lists."""
    grains_out, source, replicas_out = ti.static((world_out.grains, world_out.source, world_out.replicas))
    base = side_block(grains_out, r, replicas_out.side[r])
    row = r * grains_out.capacity
    count = replicas_out.released[r]
    while count < replicas_out.total[r] and source.release_step[row + count] <= replicas_out.step[r]:
        grains_out.origin[base + count] = source.position[row + count]
        grains_out.shift[base + count] = 0.0 * source.velocity[row + count]
        grains_out.velocity[base + count] = source.velocity[row + count]
        grains_out.spin[base + count] = source.spin[row + count]
        grains_out.radius[base + count] = source.radius[row + count]
        grains_out.mass_inverse[base + count] = source.mass_inverse[row + count]
        grains_out.material[base + count] = source.material[row + count]
        grains_out.ident[base + count] = count
        if ti.static(world_out.driven):
            clear_held(world_out.held, base + count)
        for bounds_out in ti.static((world_out.pairs, world_out.wall_pairs)):
            bounds_out.start[base + count] = 0
            bounds_out.stop[base + count] = 0
        count += 1
    replicas_out.released[r] = count


@ti.func
def margin(replicas: ti.template(), r, radius, speed):
    """Distance that a grain may move before its list is stale [m]."""
    least = replicas.margin_least[r] * radius
    return ti.min(ti.max(least, speed * replicas.margin_time[r]), replicas.margin_most[r])


@ti.func
def move_grains(world_out: ti.template(), r, p):
    """Copy partition p to the other side in sorted order, folding the shift into the origin."""
    grains_out, replicas = ti.static((world_out.grains, world_out.replicas))
    old = side_block(grains_out, r, replicas.side[r])
    new = side_block(grains_out, r, 1 - replicas.side[r])
    count = replicas.released[r]
    first = partition_first(count, replicas.partitions[r], p)
    for rank in range(first, partition_first(count, replicas.partitions[r], p + 1)):
        i = old + world_out.cells.order[r * grains_out.capacity + rank]
        k = new + rank
        velocity = grains_out.velocity[i]
        radius = grains_out.radius[i]
        allowed = margin(replicas, r, radius, velocity.norm())
        grains_out.origin[k] = position_of(grains_out, replicas, r, i)
        grains_out.shift[k] = 0.0 * velocity
        grains_out.velocity[k] = velocity
        grains_out.spin[k] = grains_out.spin[i]
        grains_out.radius[k] = radius
        grains_out.mass_inverse[k] = grains_out.mass_inverse[i]
        grains_out.travel_squared[k] = allowed * allowed
        grains_out.material[k] = grains_out.material[i]
        grains_out.ident[k] = grains_out.ident[i]
        if ti.static(world_out.driven):
            move_held(world_out.held, k, i)


@ti.func
def closeness(world: ti.template(), r, i, j):
    """How places i and j stand: 0 far apart, 1 may touch before the next rebuild, 2 touching."""
    grains, replicas = ti.static((world.grains, world.replicas))
    difference = nearest_image(grains.origin[i] - grains.origin[j], replicas.period[r])
    contact_distance = grains.radius[i] + grains.radius[j]
    allowed = ti.sqrt(grains.travel_squared[i]) + ti.sqrt(grains.travel_squared[j]) + replicas.reach[r]
    distance_squared = ti.cast(difference.norm_sqr(), float)
    stand = ti.cast(distance_squared < (contact_distance + allowed) ** 2, ti.i32)
    stand += ti.cast(distance_squared < contact_distance * contact_distance, ti.i32)
    if ti.static(world.clumped):
        row = r * grains.capacity
        if world.source.body[row + grains.ident[i]] == world.source.body[row + grains.ident[j]]:
            stand = 0
    return stand


@ti.func
def row_piece(cells: ti.template(), periodic, r, place, row, piece):
    """Ranks [first, last) of one run of cells in row `row` after the cell `place`; empty outside the grid.

    Piece 0 is the run inside the grid, piece 1 the one cell beyond a periodic edge in x.
    """
    number = cells.number[r]
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
        first = cell_start(cells, r, cell_index(cells, r, left, y, z))
        last = cell_start(cells, r, cell_index(cells, r, right, y, z) + 1)
    return first, last


@ti.func
def search_grain(world_out: ti.template(), r, rank, entry, limit):
    """List the partners of one grain from `entry` on, touching ones first; returns the number wanted.

    Nothing is written from `limit` on; a number beyond it tells the host to grow the list.
    """
    pairs_out, cells = ti.static((world_out.pairs, world_out.cells))
    base = side_block(world_out.grains, r, 1 - world_out.replicas.side[r])
    place = cell_coordinates(cells, r, world_out.grains.origin[base + rank])
    periodic = ti.cast(world_out.replicas.period[r] > 0.0, ti.i32)
    wanted = 0
    touching = 0
    for run in range(2 * ROWS):
        first, last = row_piece(cells, periodic, r, place, run // 2, run % 2)
        if run == 0:
            first = rank + 1
        for j in range(first, last):
            stand = closeness(world_out, r, base + rank, base + j)
            if stand > 0:
                if entry + wanted < limit:
                    slot = entry + wanted
                    if stand == 2:
                        pairs_out.neighbour[slot] = pairs_out.neighbour[entry + touching]
                        slot = entry + touching
                        touching += 1
                    pairs_out.neighbour[slot] = j
                wanted += 1
    return wanted


@ti.func
def remembered(pairs: ti.template(), place_i, place_j, rank_j):
    """Entry of the pair in the list of place_i, or -1."""
    found = -1
    for e in range(pairs.start[place_i], pairs.stop[place_i]):
        if pairs.neighbour[e] == rank_j:
            found = e
    return found


@ti.func
def recall(world_out: ti.template(), r, entry, rank_i, rank_j):
    """Copy the memory of a pair from the old list to `entry`; a pair seen from its other end changes sign."""
    pairs_out, grains = ti.static((world_out.pairs, world_out.grains))
    row = r * grains.capacity
    old_i = world_out.cells.order[row + rank_i]
    old_j = world_out.cells.order[row + rank_j]
    old = side_block(grains, r, world_out.replicas.side[r])
    sign = 1.0
    source = remembered(pairs_out, old + old_i, old + old_j, old_j)
    if source < 0:
        sign = -1.0
        source = remembered(pairs_out, old + old_j, old + old_i, old_i)
    slip = 0.0 * pairs_out.separation[entry]
    tilt = slip
    memory = 0
    if source >= 0:
        slip = sign * pairs_out.slip[source]
        tilt = sign * pairs_out.tilt[source]
        memory = pairs_out.label[source] & MEMORY
    pairs_out.slip[entry] = slip
    pairs_out.tilt[entry] = tilt
    return memory


@ti.func
def fill_entry(world_out: ti.template(), r, entry, rank_i, rank_j):
    """Constants and memory of one listed pair."""
    grains, pairs_out, materials = ti.static((world_out.grains, world_out.pairs, world_out.materials))
    base = side_block(grains, r, 1 - world_out.replicas.side[r])
    i = base + rank_i
    j = base + rank_j
    difference = nearest_image(grains.origin[i] - grains.origin[j], world_out.replicas.period[r])
    row = pair_row(materials, r, grains.material[i], grains.material[j])
    mass = 1.0 / (grains.mass_inverse[i] + grains.mass_inverse[j])
    pairs_out.separation[entry] = ti.cast(difference, float)
    root_radius = ti.sqrt(grains.radius[i] * grains.radius[j] / (grains.radius[i] + grains.radius[j]))
    inertia = ROLLING_INERTIA / (
        grains.mass_inverse[i] / grains.radius[i] ** 2 + grains.mass_inverse[j] / grains.radius[j] ** 2
    )
    pairs_out.root_radius[entry] = root_radius
    pairs_out.damping[entry] = materials.damping[row] * ti.sqrt(mass)
    pairs_out.rolling_damping[entry] = world_out.laws.rolling_constant(materials, row, root_radius, inertia)
    pairs_out.label[entry] = (row << ROW_SHIFT) + recall(world_out, r, entry, rank_i, rank_j)


@ti.func
def list_partition(world_out: ti.template(), r, p):
    """Fill the lists of one partition; remember how far its forces will reach."""
    pairs_out, replicas_out = ti.static((world_out.pairs, world_out.replicas))
    side = 1 - replicas_out.side[r]
    base = side_block(world_out.grains, r, side)
    count = replicas_out.released[r]
    first = partition_first(count, replicas_out.partitions[r], p)
    last = partition_first(count, replicas_out.partitions[r], p + 1)
    entry = entry_block(pairs_out, r, side) + partition_entries(pairs_out, replicas_out, r, p)
    limit = entry + pairs_out.capacity // replicas_out.partitions[r]
    low = first
    high = last
    short = 0
    for rank in range(first, last):
        wanted = search_grain(world_out, r, rank, entry, limit)
        listed = ti.min(wanted, limit - entry)
        short += wanted - listed
        pairs_out.start[base + rank] = entry
        pairs_out.stop[base + rank] = entry + listed
        for e in range(entry, entry + listed):
            j = pairs_out.neighbour[e]
            low = ti.min(low, j)
            high = ti.max(high, j + 1)
            fill_entry(world_out, r, e, rank, j)
        entry += listed
    replicas_out.short[r, p] = short
    replicas_out.touched_low[r, p] = low
    replicas_out.touched_high[r, p] = high
