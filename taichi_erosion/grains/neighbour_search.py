"""Rebuild of the neighbour list: release and sort grains, search partners in adjacent cells, copy histories.

A grain may move by its skin h before the list is rebuilt (`grains.neighbour_list`). A pair is listed when

    |x_i - x_j| < R_i + R_j + h_i + h_j + reach,

with the reach of grains that have touched where these two have and attract each other since, else with that
of grains that have not. A rebuild is due as soon as any grain has moved by more than its h: no contact can be
missed.
"""

from taichi_erosion.core.effect_device import copy_effect_states, set_initial_effect_states
from taichi_erosion.core.ti import nearest_image, ti
from taichi_erosion.grains.cells import (
    arrange_along_axes,
    cell_coordinates,
    cell_index,
    cell_of_run,
    cells_within,
    first_rank_of_cell,
    nearest_image_distances,
    wrapped_position,
)
from taichi_erosion.grains.contact import ROLLING_INERTIA
from taichi_erosion.grains.frozen_drag import clear_frozen_drag, copy_frozen_drag
from taichi_erosion.grains.materials import pair_row
from taichi_erosion.grains.neighbour_list import (
    HISTORY,
    MET,
    ROW_SHIFT,
    entry_count,
    is_wide_grain,
    partition_first_entry,
    verlet_skin,
)
from taichi_erosion.grains.sleep import copy_sleep_state, set_awake
from taichi_erosion.grains.state import side_start

TOUCHING = 1e-5  # of the distance of two grains: nearer to touching than this they count as touching [1]
ROWS = 5  # rows of cells that follow a cell: the rest of its own row, one beside it, three above


@ti.func
def find_pair_entry(pairs: ti.template(), place_i, place_j, rank_j):
    """Entry of the pair in the list of place_i, or -1."""
    entry = -1
    for k in range(entry_count(pairs, place_i)):
        e = pairs.start[place_i] + k * pairs.stride
        if pairs.neighbour[e] == rank_j:
            entry = e
    return entry


@ti.func
def find_old_entry(world: ti.template(), r, rank_i, rank_j):
    """Entry of a pair in the old lists, or -1, and the sign of its history for the first grain."""
    row, old = r * world.grains.capacity, side_start(world.grains, r, world.replicas.side[r])
    old_i, old_j = world.cells.order[row + rank_i], world.cells.order[row + rank_j]
    sign, source = 1.0, find_pair_entry(world.pairs, old + old_i, old + old_j, old_j)
    if source < 0:
        sign, source = -1.0, find_pair_entry(world.pairs, old + old_j, old + old_i, old_i)
    return source, sign


@ti.func
def pair_proximity(world: ti.template(), r, i, j, period):
    """Relation of places i and j: 0 far apart, 1 may touch before the next rebuild, 2 touching."""
    (grains,) = ti.static((world.grains,))
    within = grains.extent[i] + grains.extent[j] + world.replicas.reach[r]
    away = nearest_image_distances(ti.abs(grains.origin[i] - grains.origin[j]), period)
    distance_squared = ti.cast(away.norm_sqr(), float)
    state = 0
    if distance_squared < within * within:
        contact_distance = grains.radius[i] + grains.radius[j]
        state = 1 + ti.cast(distance_squared < contact_distance * contact_distance, ti.i32)
        if ti.static(world.pair_effects.any):
            free = within - world.replicas.met_reach[r]
            if distance_squared >= free * free:
                base = side_start(grains, r, 1 - world.replicas.side[r])
                source, _ = find_old_entry(world, r, i - base, j - base)
                state = ti.select(source < 0, 0, world.pairs.label[ti.max(source, 0)] & MET) // MET
    if ti.static(world.has_clumps):
        row = r * grains.capacity
        if world.source.body[row + grains.ident[i]] == world.source.body[row + grains.ident[j]]:
            state = 0
    return state


@ti.func
def ranks_of_cell_run(cells: ti.template(), number, periodic, r, place, row, piece):
    """Ranks [first, last) of one run of cells in row `row` after the cell `place`; empty outside the grid.

    `number` cells and `periodic` flags go along the arranged axes, called x, y, z here. Piece 0 is the run
    inside the grid, piece 1 the one cell beyond a periodic edge in x.
    """
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
    exists = piece == 0 or (periodic[0] == 1 and ((place[0] == 0 and row > 0) or place[0] == number[0] - 1))
    first = 0
    last = 0
    if exists and 0 <= y < number[1] and z < number[2]:
        first = first_rank_of_cell(cells, r, cell_index(number, (left, y, z)))
        last = first_rank_of_cell(cells, r, cell_index(number, (right, y, z)) + 1)
    return first, last


@ti.func
def append_partner(world_out: ti.template(), entry, limit, partners, touching, j, state):
    """Write partner j behind the `partners` written, `touching` first, and return both numbers.

    Nothing is written from `limit` on; a number beyond it makes the host grow the list.
    """
    (pairs_out,) = ti.static((world_out.pairs,))
    if state > 0:
        if entry + partners * pairs_out.stride < limit:
            slot = entry + partners * pairs_out.stride
            if state == 2:
                pairs_out.neighbour[slot] = pairs_out.neighbour[entry + touching * pairs_out.stride]
                slot = entry + touching * pairs_out.stride
                touching += 1
            pairs_out.neighbour[slot] = j
        partners += 1
    return partners, touching


@ti.func
def list_partners_in_cells(world_out: ti.template(), r, rank, entry, limit):
    """List the partners of one grain in its own and adjacent cells, wide partners excepted."""
    (cells,) = ti.static((world_out.cells,))
    base = side_start(world_out.grains, r, 1 - world_out.replicas.side[r])
    place = cell_coordinates(cells, r, world_out.grains.origin[base + rank])
    period = world_out.replicas.period[r]
    periodic = arrange_along_axes(cells, r, ti.cast(period > 0.0, ti.i32))
    number = arrange_along_axes(cells, r, cells.number[r])
    partners, touching = 0, 0
    for run in range(2 * ROWS):
        first, last = ranks_of_cell_run(cells, number, periodic, r, place, run // 2, run % 2)
        if run == 0:
            first = rank + 1
        for j in range(first, last):
            state = pair_proximity(world_out, r, base + rank, base + j, period)
            if state > 0:
                if is_wide_grain(world_out, r, base + j):
                    state = 0
                partners, touching = append_partner(world_out, entry, limit, partners, touching, j, state)
    return partners


@ti.func
def list_partners_of_wide(world_out: ti.template(), r, rank, entry, limit):
    """List the partners of a wide grain in a box of cells; a pair of wide grains is listed by the first."""
    cells, replicas = ti.static((world_out.cells, world_out.replicas))
    base = side_start(world_out.grains, r, 1 - replicas.side[r])
    distance = world_out.grains.extent[base + rank] + replicas.extent_most[r] + replicas.reach[r]
    place, count = cells_within(cells, replicas, r, world_out.grains.origin[base + rank], distance)
    number = arrange_along_axes(cells, r, cells.number[r])
    beyond = ti.max(place + count - number, 0)  # cells at the beginning of a period
    partners, touching = 0, 0
    for run in range(2 * count[1] * count[2]):  # in the order of the grains
        y = cell_of_run(place[1], beyond[1], run // 2 % count[1])
        z = cell_of_run(place[2], beyond[2], run // 2 // count[1])
        left, right = 0, beyond[0]
        if run % 2 == 1:
            left, right = place[0], place[0] + count[0] - beyond[0]
        first = first_rank_of_cell(cells, r, cell_index(number, (left, y, z)))
        for j in range(first, first_rank_of_cell(cells, r, cell_index(number, (right, y, z)))):
            state = pair_proximity(world_out, r, base + rank, base + j, replicas.period[r])
            if state > 0:
                if j == rank or (j < rank and is_wide_grain(world_out, r, base + j)):
                    state = 0
                partners, touching = append_partner(world_out, entry, limit, partners, touching, j, state)
    return partners


@ti.func
def list_partners(world_out: ti.template(), r, rank, entry, limit):
    """List the partners of one grain from `entry` on; returns the number of entries needed."""
    base = side_start(world_out.grains, r, 1 - world_out.replicas.side[r])
    partners = 0
    if is_wide_grain(world_out, r, base + rank):
        partners = list_partners_of_wide(world_out, r, rank, entry, limit)
    else:
        partners = list_partners_in_cells(world_out, r, rank, entry, limit)
    return partners


@ti.func
def release_grain(world_out: ti.template(), r, rank):
    """Put the next grain of the GrainTable at place `rank` of the valid side, with empty lists."""
    grains_out, source = ti.static((world_out.grains, world_out.source))
    i = side_start(grains_out, r, world_out.replicas.side[r]) + rank
    ident = rank + world_out.replicas.removed[r]
    row = r * grains_out.capacity + ident
    grains_out.origin[i] = source.position[row]
    grains_out.shift[i] = 0.0 * source.velocity[row]
    grains_out.velocity[i] = source.velocity[row]
    grains_out.spin[i] = source.spin[row]
    grains_out.radius[i] = source.radius[row]
    grains_out.mass_inverse[i] = source.mass_inverse[row]
    grains_out.material[i] = source.material[row]
    grains_out.ident[i] = ident
    if ti.static(world_out.has_external_forces):
        clear_frozen_drag(world_out.frozen_drag, i)
    if ti.static(world_out.sleeps):
        set_awake(world_out.sleep, i)
    if ti.static(world_out.has_state):
        set_initial_effect_states(world_out.pair_effects, r, i)
        set_initial_effect_states(world_out.grain_effects, r, i)
    for bounds_out in ti.static((world_out.pairs, world_out.wall_pairs)):
        bounds_out.start[i] = 0
        bounds_out.stop[i] = 0


@ti.func
def is_release_due(world: ti.template(), r, rank):
    """Whether a grain waits that would get place `rank`, and its release step has come."""
    (replicas,) = ti.static((world.replicas,))
    ident = rank + replicas.removed[r]
    row = r * world.grains.capacity + ident
    return ident < replicas.total[r] and world.source.release_step[row] <= replicas.step[r]


@ti.func
def release_grains(world_out: ti.template(), r):
    """Append the grains whose release step has come to the valid side, with empty lists."""
    (replicas_out,) = ti.static((world_out.replicas,))
    count = replicas_out.released[r]
    while is_release_due(world_out, r, count):
        release_grain(world_out, r, count)
        count += 1
    replicas_out.released[r] = count
    replicas_out.bounds[r, replicas_out.partitions[r]] = count


@ti.func
def copy_grain_to_rank(world_out: ti.template(), r, rank):
    """Copy the grain that the sort puts at `rank` to the other side, with the shift added to the origin."""
    grains_out, replicas = ti.static((world_out.grains, world_out.replicas))
    i = side_start(grains_out, r, replicas.side[r]) + world_out.cells.order[r * grains_out.capacity + rank]
    k = side_start(grains_out, r, 1 - replicas.side[r]) + rank
    velocity = grains_out.velocity[i]
    radius = grains_out.radius[i]
    allowed = verlet_skin(replicas, r, radius, velocity.norm())
    grains_out.origin[k] = wrapped_position(grains_out, replicas, r, i)
    grains_out.shift[k] = 0.0 * velocity
    grains_out.velocity[k] = velocity
    grains_out.spin[k] = grains_out.spin[i]
    grains_out.radius[k] = radius
    grains_out.mass_inverse[k] = grains_out.mass_inverse[i]
    grains_out.skin_squared[k] = allowed * allowed
    grains_out.extent[k] = radius + allowed
    grains_out.material[k] = grains_out.material[i]
    grains_out.ident[k] = grains_out.ident[i]
    if ti.static(world_out.has_external_forces):
        copy_frozen_drag(world_out.frozen_drag, k, i)
    if ti.static(world_out.sleeps):
        copy_sleep_state(world_out.sleep, k, i)
    if ti.static(world_out.has_state):
        copy_effect_states(world_out.pair_effects, k, i)
        copy_effect_states(world_out.grain_effects, k, i)


@ti.func
def copy_grains_in_order(world_out: ti.template(), r, p):
    """Copy partition p to the other side in sorted order."""
    for rank in range(world_out.replicas.bounds[r, p], world_out.replicas.bounds[r, p + 1]):
        copy_grain_to_rank(world_out, r, rank)


@ti.func
def copy_pair_history(world_out: ti.template(), r, entry, rank_i, rank_j):
    """Copy the history of a pair from the old list to `entry`; its sign is that of the first grain."""
    (pairs_out,) = ti.static((world_out.pairs,))
    source, sign = find_old_entry(world_out, r, rank_i, rank_j)
    tangential_displacement = 0.0 * pairs_out.separation[entry]
    rolling_displacement = tangential_displacement
    history = 0
    if source >= 0:
        tangential_displacement = sign * pairs_out.tangential_displacement[source]
        rolling_displacement = sign * pairs_out.rolling_displacement[source]
        history = pairs_out.label[source] & HISTORY
    pairs_out.tangential_displacement[entry] = tangential_displacement
    pairs_out.rolling_displacement[entry] = rolling_displacement
    return history


@ti.func
def may_have_history(world: ti.template(), i, j, difference):
    """Whether a contact of places i and j may have a history: touching, adhesive, or with pair effects."""
    (grains,) = ti.static((world.grains,))
    persists = True
    if ti.static(not (world.laws.adhesive or world.pair_effects.any)):
        contact_distance = (1.0 + TOUCHING) * (grains.radius[i] + grains.radius[j])
        persists = difference.norm_sqr() < contact_distance * contact_distance
    return persists


@ti.func
def write_pair_entry(world_out: ti.template(), r, entry, rank_i, rank_j):
    """Constants and contact history of one listed pair."""
    grains, pairs_out, materials = ti.static((world_out.grains, world_out.pairs, world_out.materials))
    base = side_start(grains, r, 1 - world_out.replicas.side[r])
    i = base + rank_i
    j = base + rank_j
    difference = nearest_image(grains.origin[i] - grains.origin[j], world_out.replicas.period[r])
    row = pair_row(materials, r, grains.material[i], grains.material[j])
    mass = 1.0 / (grains.mass_inverse[i] + grains.mass_inverse[j])
    pairs_out.owner[entry] = rank_i
    pairs_out.separation[entry] = ti.cast(difference, float)
    root_radius = ti.sqrt(grains.radius[i] * grains.radius[j] / (grains.radius[i] + grains.radius[j]))
    inertia = ROLLING_INERTIA / (
        grains.mass_inverse[i] / grains.radius[i] ** 2 + grains.mass_inverse[j] / grains.radius[j] ** 2
    )
    pairs_out.root_radius[entry] = root_radius
    pairs_out.damping[entry] = materials.damping[row] * ti.sqrt(mass)
    pairs_out.rolling_damping[entry] = world_out.laws.rolling_constant(materials, row, root_radius, inertia)
    history = 0
    if may_have_history(world_out, i, j, difference):
        history = copy_pair_history(world_out, r, entry, rank_i, rank_j)
    else:
        pairs_out.tangential_displacement[entry] = 0.0 * pairs_out.tangential_displacement[entry]
        pairs_out.rolling_displacement[entry] = 0.0 * pairs_out.rolling_displacement[entry]
    pairs_out.label[entry] = (row << ROW_SHIFT) + history


@ti.func
def extend_range(ranks, rank):
    """Range [lowest rank, one past the highest) extended by one rank."""
    return ti.Vector([ti.min(ranks[0], rank), ti.max(ranks[1], rank + 1)])


@ti.func
def list_partition_pairs(world_out: ti.template(), r, p):
    """Fill the lists of one partition, and record the ranks that its forces reach."""
    pairs_out, replicas_out = ti.static((world_out.pairs, world_out.replicas))
    side = 1 - replicas_out.side[r]
    base = side_start(world_out.grains, r, side)
    first, last = replicas_out.bounds[r, p], replicas_out.bounds[r, p + 1]
    entry = side_start(pairs_out, r, side) + partition_first_entry(pairs_out, replicas_out, r, p)
    limit = entry + pairs_out.capacity // replicas_out.partitions[r]
    before, behind = ti.Vector([first, 0]), ti.Vector([replicas_out.released[r], 0])
    short = 0
    for rank in range(first, last):
        partners = list_partners(world_out, r, rank, entry, limit)
        entries = ti.min(partners, limit - entry)
        short += partners - entries
        pairs_out.start[base + rank] = entry
        pairs_out.stop[base + rank] = entry + entries
        for e in range(entry, entry + entries):
            j = pairs_out.neighbour[e]
            if j < first:
                before = extend_range(before, j)
            if j >= last:
                behind = extend_range(behind, j)
            write_pair_entry(world_out, r, e, rank, j)
        entry += entries
    replicas_out.short[r, p] = short
    replicas_out.before_low[r, p], replicas_out.before_high[r, p] = before
    replicas_out.after_low[r, p], replicas_out.after_high[r, p] = behind
