"""Rebuild of the lists of the replicas that need it: stages over their grains and cells.

Release, checks of positions, the grid of cells, a counting sort, moves, the search, and the swap of sides.
Counts are added by atomic operations on integers, and what they scatter is sorted afterwards: lists are those
of `grains.neighbour_search`, entry for entry, with reverse lists. Where numbers become bounds (a prefix sum),
one stage sums each chunk, and the next adds the sums of the chunks before. The places of a grain in the lists
of pairs follow from its rank, those in the list of walls are taken as they come: no result depends on them.
"""

from taichi_erosion.core.ti import ti
from taichi_erosion.grains import World
from taichi_erosion.grains.cells import (
    GONE,
    box_and_position_sums,
    box_of_most_grains,
    cell_of_grain,
    divide_box_into_cells,
    first_cell_place,
    first_rank_of_cell,
    order_axes_by_cells,
)
from taichi_erosion.grains.clumps import record_sphere_places
from taichi_erosion.grains.neighbour_list import entry_count
from taichi_erosion.grains.neighbour_search import (
    copy_grain_to_rank,
    is_release_due,
    list_partners,
    release_grain,
    write_pair_entry,
)
from taichi_erosion.grains.state import side_start
from taichi_erosion.grains.wall_contacts import list_walls_of_grain
from taichi_erosion.simulation.grain_decomposition.buffers import GrainBuffers, Stage, insertion_sort
from taichi_erosion.simulation.grain_decomposition.forces import clear_pair_force
from taichi_erosion.simulation.step import count_removed, mark_removal, position_fault, stop_at, swap_sides


@ti.func
def is_renewing_lists(world: ti.template(), coupling: ti.template(), buffers: ti.template(), r):
    """Whether the lists of replica r are renewed now."""
    return buffers.renewing[r] == 1


@ti.func
def release_in_chunk(world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, k):
    """Release the grains of one chunk that are due; lost grains, and sums of positions.

    The table is in the order of release.
    """
    grains, replicas_out = ti.static((world_out.grains, world_out.replicas))
    begin, before = k * buffers_out.grain_chunk, replicas_out.released[r]
    end, lost, leaving = begin, 0, 0
    for rank in range(begin, ti.min(begin + buffers_out.grain_chunk, replicas_out.total[r])):
        if rank < before or is_release_due(world_out, r, rank):
            if rank >= before:
                release_grain(world_out, r, rank)
            fault, _ = position_fault(world_out, r, rank)
            leaves = mark_removal(world_out, r, rank, fault)
            leaving += leaves
            if fault != 0 and leaves == 0:
                lost = rank + 1
            end = rank + 1
    ti.atomic_max(buffers_out.lost[r], lost)
    ti.atomic_add(replicas_out.leaving[r], leaving)
    if end > begin:
        ti.atomic_max(replicas_out.bounds[r, 1], end)
    place = r * buffers_out.grain_chunks + k
    low, high, total, squares = box_and_position_sums(grains, replicas_out, r, begin, end)
    buffers_out.low[place], buffers_out.high[place] = low, high
    buffers_out.total[place], buffers_out.squares[place] = total, squares


@ti.func
def clear_cell(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, c):
    """Empty a cell, or one of the two places behind all cells."""
    world_out.cells.first[first_cell_place(world_out.cells, r) + c] = 0


@ti.func
def fit_cell_grid(world_out: ti.template(), buffers: ti.template(), r):
    """Grid of cells around the grains of replica r, from the sums of its chunks in their order."""
    (replicas,) = ti.static((world_out.replicas,))
    low, high = replicas.high[r], replicas.low[r]
    total, squares = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
    first = r * buffers.grain_chunks
    for place in range(first, first + buffers.grain_chunks):
        low, high = ti.min(low, buffers.low[place]), ti.max(high, buffers.high[place])
        total += buffers.total[place]
        squares += buffers.squares[place]
    low, high = box_of_most_grains(replicas, r, low, high, total, squares)
    divide_box_into_cells(world_out.cells, replicas, r, low, high)


@ti.func
def prepare_sort(world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, _):
    """Stop replica r where a grain is lost; else fit its grid."""
    replicas_out, cells_out = ti.static((world_out.replicas, world_out.cells))
    replicas_out.released[r] = replicas_out.bounds[r, 1]
    replicas_out.short[r, 0], replicas_out.wall_short[r, 0] = 0, 0
    buffers_out.listed[r], buffers_out.listed_walls[r], buffers_out.walled[r] = 0, 0, 0
    lost = buffers_out.lost[r] - 1  # a place that stops the replica
    if lost >= 0:
        fault, value = position_fault(world_out, r, lost)
        stop_at(replicas_out, r, lost, fault, value)
    else:
        if ti.static(not world_out.has_external_forces):
            fit_cell_grid(world_out, buffers_out, r)
        order_axes_by_cells(cells_out, r)
        number, chunk = cells_out.number[r], 1
        cells = number[0] * number[1] * number[2]
        while chunk * chunk < cells:
            chunk *= 2
        buffers_out.cells[r], buffers_out.cell_chunk[r] = cells, chunk


@ti.func
def count_in_cell(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, rank):
    """Note the cell of a grain, and count it there: two places on, so that filling leaves the bounds."""
    cells_out, grains = ti.static((world_out.cells, world_out.grains))
    if is_rebuilding_grain(world_out, r, rank) and is_grain_kept(world_out, r, rank):
        i = side_start(grains, r, world_out.replicas.side[r]) + rank
        c = cell_of_grain(cells_out, grains, world_out.replicas, r, i)
        cells_out.cell[r * grains.capacity + rank] = c
        ti.atomic_add(cells_out.first[first_cell_place(cells_out, r) + c + 2], 1)


@ti.func
def is_grain_kept(world: ti.template(), r, rank):
    """Whether a grain is not taken out by this rebuild."""
    return world.replicas.leaving[r] == 0 or world.cells.cell[r * world.grains.capacity + rank] != GONE


@ti.func
def drop_removed(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, _):
    """Count out the grains that the sort has left behind."""
    if world_out.replicas.status[r] == 0:
        count_removed(world_out.replicas, r, world_out.replicas.leaving[r])


@ti.func
def count_in_chunk(world: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, k):
    size, total = buffers_out.cell_chunk[r], 0
    first = first_cell_place(world.cells, r) + 2
    for c in range(k * size, ti.min((k + 1) * size, buffers_out.cells[r])):
        total += world.cells.first[first + c]
    buffers_out.cell_sums[r * buffers_out.cell_chunks + k] = total


@ti.func
def set_cell_starts(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, k):
    """Rank of the first grain of every cell of one chunk."""
    (numbers_out,) = ti.static((world_out.cells.first,))
    first, size = first_cell_place(world_out.cells, r) + 2, buffers.cell_chunk[r]
    if k * size < buffers.cells[r]:
        rank, place = 0, r * buffers.cell_chunks
        for chunk in range(place, place + k):
            rank += buffers.cell_sums[chunk]
        for c in range(k * size, ti.min((k + 1) * size, buffers.cells[r])):
            number = numbers_out[first + c]
            numbers_out[first + c] = rank
            rank += number


@ti.func
def put_in_cell(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, rank):
    """Put a grain at the next free place of its cell."""
    (cells_out,) = ti.static((world_out.cells,))
    if is_rebuilding_grain(world_out, r, rank) and is_grain_kept(world_out, r, rank):
        row = r * world_out.grains.capacity
        c = cells_out.cell[row + rank]
        place = ti.atomic_add(cells_out.first[first_cell_place(cells_out, r) + c + 2], 1)
        cells_out.order[row + place] = rank


@ti.func
def sort_one_cell(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, c):
    """Order the grains of a cell by their rank before the sort, as a stable sort does."""
    if world_out.replicas.status[r] == 0 and c < buffers.cells[r]:
        row = r * world_out.grains.capacity
        begin, end = first_rank_of_cell(world_out.cells, r, c), first_rank_of_cell(world_out.cells, r, c + 1)
        insertion_sort(world_out.cells.order, row + begin, end - begin, 1)


@ti.func
def copy_to_place(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, rank):
    if is_rebuilding_grain(world_out, r, rank):
        copy_grain_to_rank(world_out, r, rank)


@ti.func
def clear_reverse_list(
    world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, rank
):
    buffers_out.partners[r * world_out.grains.capacity + rank] = 0


@ti.func
def write_pairs(world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, rank):
    """Entries of one grain for its partners, with constants and histories, and in their reverse lists."""
    pairs_out, replicas_out = ti.static((world_out.pairs, world_out.replicas))
    if is_rebuilding_grain(world_out, r, rank):
        i = side_start(world_out.grains, r, 1 - replicas_out.side[r]) + rank
        block, stride = side_start(pairs_out, r, 1 - replicas_out.side[r]), pairs_out.stride
        first, room = block + rank, pairs_out.capacity // stride
        partners = list_partners(world_out, r, rank, first, first + room * stride)
        pairs_out.start[i] = first
        pairs_out.stop[i] = first + ti.min(partners, room) * stride
        ti.atomic_max(buffers_out.listed[r], ti.min(partners, room) * stride)
        ti.atomic_max(replicas_out.short[r, 0], partners - room)
        for k in range(entry_count(pairs_out, i)):
            e = first + k * stride
            write_pair_entry(world_out, r, e, rank, pairs_out.neighbour[e])
            add_to_reverse_list(world_out, buffers_out, r, e - block, pairs_out.neighbour[e])
            clear_pair_force(buffers_out, r * pairs_out.capacity + e - block)


@ti.func
def add_to_reverse_list(world_out: ti.template(), buffers_out: ti.template(), r, k, j):
    """Write the entry at place k to the reverse list of its second grain, of rank j."""
    stride, room = world_out.pairs.stride, world_out.pairs.capacity // world_out.pairs.stride
    number = ti.cast(ti.atomic_add(buffers_out.partners[r * world_out.grains.capacity + j], 1), ti.i32)
    ti.atomic_max(world_out.replicas.short[r, 0], number + 1 - room)
    if number < room:
        buffers_out.partner_entry[r * world_out.pairs.capacity + number * stride + j] = k


@ti.func
def sort_reverse(world: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, rank):
    """Order the reverse list of a grain by entry."""
    if is_rebuilding_grain(world, r, rank):
        first, stride = r * world.pairs.capacity + rank, world.pairs.stride
        room, number = world.pairs.capacity // stride, buffers_out.partners[r * world.grains.capacity + rank]
        insertion_sort(buffers_out.partner_entry, first, ti.min(number, room), stride)


@ti.func
def write_walls(world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, rank):
    """Entries of one grain for the walls near it."""
    entries_out, replicas_out = ti.static((world_out.wall_pairs, world_out.replicas))
    if is_rebuilding_grain(world_out, r, rank):
        i = side_start(world_out.grains, r, 1 - replicas_out.side[r]) + rank
        entry = side_start(entries_out, r, 1 - replicas_out.side[r])
        count = list_walls_of_grain(world_out, r, rank, 0, 0)
        limit = entry + entries_out.capacity
        if count > 0:
            entry += ti.atomic_add(buffers_out.listed_walls[r], count)
            if entry + count > limit:
                ti.atomic_max(replicas_out.wall_short[r, 0], entry + count - limit)
            list_walls_of_grain(world_out, r, rank, entry, limit)
            place = ti.atomic_add(buffers_out.walled[r], 1)
            buffers_out.walled_rank[r * world_out.grains.capacity + place] = rank
        entries_out.start[i] = entry
        entries_out.stop[i] = entry + count


@ti.func
def is_rebuilding_grain(world: ti.template(), r, rank):
    """Whether a replica is still being rebuilt and has a grain of that rank."""
    return world.replicas.status[r] == 0 and rank < world.replicas.released[r]


@ti.func
def end_rebuild(world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, _):
    """Swap the sides of replica r, which steps on where nothing is wrong."""
    if world_out.replicas.status[r] == 0:
        swap_sides(world_out.replicas, r)
        world_out.replicas.need[r, 0] = 0
    if world_out.replicas.status[r] != 0:
        buffers_out.stepping[r] = 0
        ti.atomic_sub(buffers_out.running[0], 1)


@ti.func
def locate_sphere(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, rank):
    """Record where the sort has put a sphere of a clump."""
    if is_rebuilding_grain(world_out, r, rank):
        record_sphere_places(world_out, r, rank, rank + 1)


@ti.kernel
def release_grains_at_start(world_out: ti.template()):
    """Release the grains that are there from the start, one thread a grain."""
    for n in range(world_out.replicas.count * world_out.grains.capacity):
        r, rank = n // world_out.grains.capacity, n % world_out.grains.capacity
        if is_release_due(world_out, r, rank):
            release_grain(world_out, r, rank)
            ti.atomic_max(world_out.replicas.bounds[r, 1], rank + 1)
    for r in range(world_out.replicas.count):
        world_out.replicas.released[r] = world_out.replicas.bounds[r, 1]


def rebuild_stages(world: World, buffers: GrainBuffers) -> tuple[Stage, ...]:
    """Stages of a rebuild of the replicas that need one: tasks side by side, with their threads a replica."""
    grains, cells, chunks = world.grains.capacity, world.cells.capacity, buffers.cell_chunks
    survey = ((release_in_chunk, buffers.grain_chunks), (clear_cell, cells + 2), (clear_reverse_list, grains))
    tasks = ((prepare_sort, 1), (count_in_cell, grains), (count_in_chunk, chunks), (set_cell_starts, chunks))
    sort = (((put_in_cell, grains),), ((sort_one_cell, cells), (drop_removed, 1)), ((copy_to_place, grains),))
    lists, end = ((write_pairs, grains), (write_walls, grains)), ((end_rebuild, 1), (sort_reverse, grains))
    stages = [survey, *((task,) for task in tasks), *sort, lists, end]
    if world.has_clumps:
        stages.append(((locate_sphere, grains),))
    return tuple(tuple((is_renewing_lists, *task) for task in stage) for stage in stages)
