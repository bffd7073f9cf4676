"""Rebuild of the lists of the queued replicas: a chain of stages over their grains, cells and entries.

Release, checks of positions, the grid of cells, a counting sort, moves, two searches (the first counts the
entries, the second writes them), and the swap of sides. Counts are added by atomic operations on integers,
and what they scatter is sorted afterwards: lists are those of `grains.neighbour_search`, entry for entry.
Reverse lists follow: for every grain the entries in which it is the second of the pair. Where numbers become
bounds (a prefix sum), one stage sums each chunk, and the next adds the sums of the chunks before.
"""

from taichi_erosion.core.ti import ti
from taichi_erosion.grains import World
from taichi_erosion.grains.cells import (
    arrange_axes,
    cell_start,
    divide_box,
    grain_cell,
    most_of,
    row_of_cells,
    sums_of_positions,
)
from taichi_erosion.grains.clumps import locate_spheres
from taichi_erosion.grains.neighbour_list import WIDE_MOST, entry_block, wants_more_than_cells
from taichi_erosion.grains.neighbour_search import (
    is_due,
    move_grain,
    release_grain,
    search_grain,
    write_entry,
)
from taichi_erosion.grains.state import side_block
from taichi_erosion.grains.wall_contacts import list_grain
from taichi_erosion.simulation.grain_decomposition.buffers import (
    NO_FAULT,
    GrainBuffers,
    Stages,
    sort_run,
    sum_before,
    sum_chunk,
)
from taichi_erosion.simulation.step import position_fault, stop_at, swap_sides


@ti.func
def begin_rebuild(world_out: ti.template(), buffers_out: ti.template(), r, _):
    """Count the grains whose release step has come; the table is in the order of release."""
    (replicas_out,) = ti.static((world_out.replicas,))
    low, high = replicas_out.released[r], replicas_out.total[r]
    buffers_out.before[r] = low
    while low < high:
        middle = (low + high) // 2
        if is_due(world_out, r, middle):
            low = middle + 1
        else:
            high = middle
    replicas_out.released[r] = low
    replicas_out.bounds[r, 1] = low
    buffers_out.wide[r], buffers_out.lost[r] = 0, 0


@ti.func
def release(world_out: ti.template(), buffers: ti.template(), r, rank):
    """Put a grain that is released now at its place."""
    if buffers.before[r] <= rank < world_out.replicas.released[r]:
        release_grain(world_out, r, rank)


@ti.func
def survey_chunk(world: ti.template(), buffers_out: ti.template(), r, k):
    """Lost grains, grains with wide skins, and sums of positions of one chunk of grains."""
    (replicas,) = ti.static((world.replicas,))
    base = side_block(world.grains, r, replicas.side[r])
    begin = k * buffers_out.grain_chunk
    end = ti.min(begin + buffers_out.grain_chunk, replicas.released[r])
    wide, lost = 0, 0
    for rank in range(begin, end):
        wide += wants_more_than_cells(world, r, base + rank)
        if position_fault(world, r, rank)[0] != 0:
            lost = rank + 1
    ti.atomic_add(buffers_out.wide[r], wide)
    ti.atomic_max(buffers_out.lost[r], lost)
    place = r * buffers_out.grain_chunks + k
    low, high, total, squares = sums_of_positions(world.grains, replicas, r, begin, end)
    buffers_out.low[place], buffers_out.high[place] = low, high
    buffers_out.total[place], buffers_out.squares[place] = total, squares


@ti.func
def fit_grid(world_out: ti.template(), buffers: ti.template(), r):
    """Grid of cells around the grains of replica r, from the sums of its chunks in their order."""
    (replicas,) = ti.static((world_out.replicas,))
    low, high = replicas.high[r], replicas.low[r]
    total, squares = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 3)
    first = r * buffers.grain_chunks
    for place in range(first, first + buffers.grain_chunks):
        low, high = ti.min(low, buffers.low[place]), ti.max(high, buffers.high[place])
        total += buffers.total[place]
        squares += buffers.squares[place]
    low, high = most_of(replicas, r, low, high, total, squares)
    divide_box(world_out.cells, replicas, r, low, high)


@ti.func
def prepare_sort(world_out: ti.template(), buffers_out: ti.template(), r, _):
    """Stop replica r where a grain is lost; else fit its grid."""
    replicas_out, cells_out = ti.static((world_out.replicas, world_out.cells))
    lost = buffers_out.lost[r] - 1
    if lost >= 0:
        fault, value = position_fault(world_out, r, lost)
        stop_at(replicas_out, r, lost, fault, value)
    else:
        replicas_out.crowded[r] = ti.cast(buffers_out.wide[r] > WIDE_MOST, ti.i32)
        if ti.static(not world_out.driven):
            fit_grid(world_out, buffers_out, r)
        arrange_axes(cells_out, r)
        number = cells_out.number[r]
        buffers_out.cells[r] = number[0] * number[1] * number[2]


@ti.func
def clear_cell(world_out: ti.template(), buffers: ti.template(), r, c):
    """Empty a cell, or one of the two places behind all cells."""
    if c < buffers.cells[r] + 2:
        world_out.cells.first[row_of_cells(world_out.cells, r) + c] = 0


@ti.func
def count_in_cell(world_out: ti.template(), buffers: ti.template(), r, rank):
    """Note the cell of a grain, and count it there: two places on, so that filling leaves the bounds."""
    cells_out, grains = ti.static((world_out.cells, world_out.grains))
    if is_ready(world_out, r, rank):
        i = side_block(grains, r, world_out.replicas.side[r]) + rank
        c = grain_cell(cells_out, grains, world_out.replicas, r, i)
        cells_out.cell[r * grains.capacity + rank] = c
        ti.atomic_add(cells_out.first[row_of_cells(cells_out, r) + c + 2], 1)


@ti.func
def sum_cells(world: ti.template(), buffers_out: ti.template(), r, k):
    """Grains in the cells of one chunk."""
    first, place = row_of_cells(world.cells, r) + 2, r * buffers_out.cell_chunks
    count, size = buffers_out.cells[r], buffers_out.cell_chunk
    sum_chunk(world.cells.first, buffers_out.cell_sums, first, count, place, k, size)


@ti.func
def bound_cells(world_out: ti.template(), buffers: ti.template(), r, k):
    """Rank of the first grain of every cell of one chunk."""
    (numbers_out,) = ti.static((world_out.cells.first,))
    first = row_of_cells(world_out.cells, r) + 2
    rank = sum_before(buffers.cell_sums, r * buffers.cell_chunks, k)
    for c in range(k * buffers.cell_chunk, ti.min((k + 1) * buffers.cell_chunk, buffers.cells[r])):
        number = numbers_out[first + c]
        numbers_out[first + c] = rank
        rank += number


@ti.func
def put_in_cell(world_out: ti.template(), buffers: ti.template(), r, rank):
    """Put a grain at the next free place of its cell."""
    (cells_out,) = ti.static((world_out.cells,))
    if is_ready(world_out, r, rank):
        row = r * world_out.grains.capacity
        c = cells_out.cell[row + rank]
        place = ti.atomic_add(cells_out.first[row_of_cells(cells_out, r) + c + 2], 1)
        cells_out.order[row + place] = rank


@ti.func
def sort_cell(world_out: ti.template(), buffers: ti.template(), r, c):
    """Order the grains of a cell by their rank before the sort, as a stable sort does."""
    if world_out.replicas.status[r] == 0 and c < buffers.cells[r]:
        row = r * world_out.grains.capacity
        begin, end = cell_start(world_out.cells, r, c), cell_start(world_out.cells, r, c + 1)
        sort_run(world_out.cells.order, row + begin, row + end)


@ti.func
def move_sorted(world_out: ti.template(), buffers: ti.template(), r, rank):
    """Copy a grain to the other side."""
    if is_ready(world_out, r, rank):
        move_grain(world_out, r, rank)


@ti.func
def new_side(world: ti.template(), r):
    """First place of the side of replica r that is being filled."""
    return side_block(world.grains, r, 1 - world.replicas.side[r])


@ti.func
def count_entries(world_out: ti.template(), buffers: ti.template(), r, rank):
    """Number of entries that the lists of a grain need, written where its first entry will stand."""
    if is_ready(world_out, r, rank):
        i = new_side(world_out, r) + rank
        world_out.pairs.start[i] = search_grain(world_out, r, rank, 0, 0)
        world_out.wall_pairs.start[i] = list_grain(world_out, r, rank, 0, 0)


@ti.func
def sum_lists(world: ti.template(), buffers_out: ti.template(), r, k):
    """Entries of the grains of one chunk."""
    count, size, base = world.replicas.released[r], buffers_out.grain_chunk, new_side(world, r)
    place = r * buffers_out.grain_chunks
    sum_chunk(world.pairs.start, buffers_out.pair_sums, base, count, place, k, size)
    sum_chunk(world.wall_pairs.start, buffers_out.wall_sums, base, count, place, k, size)


@ti.func
def bound_lists(world_out: ti.template(), buffers: ti.template(), r, k):
    """First and last entries of the grains of one chunk; the last notes how many of all do not fit."""
    (replicas_out,) = ti.static((world_out.replicas,))
    base, place = new_side(world_out, r), r * buffers.grain_chunks
    begin, end = k * buffers.grain_chunk, ti.min((k + 1) * buffers.grain_chunk, replicas_out.released[r])
    for lists_out, sums, short_out in ti.static(
        (
            (world_out.pairs, buffers.pair_sums, replicas_out.short),
            (world_out.wall_pairs, buffers.wall_sums, replicas_out.wall_short),
        )
    ):
        first = entry_block(lists_out, r, 1 - replicas_out.side[r])
        entry = first + sum_before(sums, place, k)
        for i in range(base + begin, base + end):
            number = lists_out.start[i]
            lists_out.start[i] = entry
            entry += number
            lists_out.stop[i] = entry
        if k == buffers.grain_chunks - 1:
            short_out[r, 0] = ti.max(entry - first - lists_out.capacity, 0)


@ti.func
def write_lists(world_out: ti.template(), buffers: ti.template(), r, rank):
    """Entries of one grain, with constants and histories."""
    pairs_out, walls_out = ti.static((world_out.pairs, world_out.wall_pairs))
    fits = world_out.replicas.short[r, 0] + world_out.replicas.wall_short[r, 0] == 0
    if fits and is_ready(world_out, r, rank):
        i = new_side(world_out, r) + rank
        search_grain(world_out, r, rank, pairs_out.start[i], pairs_out.stop[i])
        for e in range(pairs_out.start[i], pairs_out.stop[i]):
            write_entry(world_out, r, e, rank, pairs_out.neighbour[e])
        list_grain(world_out, r, rank, walls_out.start[i], walls_out.stop[i])


@ti.func
def is_ready(world: ti.template(), r, rank):
    """Whether a replica is still being rebuilt and has a grain of that rank."""
    return world.replicas.status[r] == 0 and rank < world.replicas.released[r]


@ti.func
def end_rebuild(world_out: ti.template(), buffers_out: ti.template(), r, _):
    """Swap the sides of replica r; its reverse lists are out of date."""
    if world_out.replicas.status[r] == 0:
        swap_sides(world_out.replicas, r)
        world_out.replicas.need[r, 0] = 0
        buffers_out.linked[r] = 0


@ti.func
def locate_sphere(world_out: ti.template(), buffers: ti.template(), r, rank):
    """Record where the sort has put a sphere of a clump."""
    if is_ready(world_out, r, rank):
        locate_spheres(world_out, r, rank, rank + 1)


def rebuild_stages(world: World, buffers: GrainBuffers) -> tuple[Stages, ...]:
    """Stages of a rebuild, kernel by kernel.

    The search stands in a kernel of its own: Taichi 1.7.4 cannot compile it for Vulkan beside other stages.
    """
    grains, cells = world.grains.capacity, world.cells.capacity
    chunks, cell_chunks = buffers.grain_chunks, buffers.cell_chunks
    begin = ((begin_rebuild, 1), (release, grains), (survey_chunk, chunks), (prepare_sort, 1))
    count = ((clear_cell, cells + 2), (count_in_cell, grains), (sum_cells, cell_chunks))
    sort = ((bound_cells, cell_chunks), (put_in_cell, grains), (sort_cell, cells), (move_sorted, grains))
    bound = ((sum_lists, chunks), (bound_lists, chunks))
    end: Stages = ((write_lists, grains), (end_rebuild, 1))
    end = (*end, (locate_sphere, grains)) if world.clumped else end
    return (*begin, *count, *sort), ((count_entries, grains),), (*bound, *end)


@ti.func
def clear_partners(world: ti.template(), buffers_out: ti.template(), r, rank):
    """Empty the reverse list of a grain."""
    buffers_out.start[r * world.grains.capacity + rank] = 0


@ti.func
def begin_link(world: ti.template(), buffers_out: ti.template(), r, _):
    """Number of entries of replica r."""
    side, released = world.replicas.side[r], world.replicas.released[r]
    listed = 0
    if released > 0:
        last = side_block(world.grains, r, side) + released - 1
        listed = world.pairs.stop[last] - entry_block(world.pairs, r, side)
    buffers_out.listed[r] = listed


@ti.func
def second_grain(world: ti.template(), r, k):
    """Place of the second grain of entry k among those of the reverse lists."""
    e = entry_block(world.pairs, r, world.replicas.side[r]) + k
    return r * world.grains.capacity + world.pairs.neighbour[e]


@ti.func
def count_partner(world: ti.template(), buffers_out: ti.template(), r, k):
    """Count an entry at its second grain."""
    if k < buffers_out.listed[r]:
        ti.atomic_add(buffers_out.start[second_grain(world, r, k)], 1)


@ti.func
def sum_partners(world: ti.template(), buffers_out: ti.template(), r, k):
    """Entries of the reverse lists of one chunk of grains."""
    first, place = r * world.grains.capacity, r * buffers_out.grain_chunks
    count, size = world.replicas.released[r], buffers_out.grain_chunk
    sum_chunk(buffers_out.start, buffers_out.pair_sums, first, count, place, k, size)


@ti.func
def bound_partners(world: ti.template(), buffers_out: ti.template(), r, k):
    """First places in the reverse lists of one chunk of grains, which end where they begin."""
    row, size = r * world.grains.capacity, buffers_out.grain_chunk
    place = r * world.pairs.capacity + sum_before(buffers_out.pair_sums, r * buffers_out.grain_chunks, k)
    for i in range(row + k * size, row + ti.min((k + 1) * size, world.replicas.released[r])):
        number = buffers_out.start[i]
        buffers_out.start[i], buffers_out.stop[i] = place, place
        place += number


@ti.func
def note_partner(world: ti.template(), buffers_out: ti.template(), r, k):
    """Write an entry to the reverse list of its second grain."""
    if k < buffers_out.listed[r]:
        place = ti.atomic_add(buffers_out.stop[second_grain(world, r, k)], 1)
        buffers_out.partner_entry[place] = k


@ti.func
def sort_partners(world: ti.template(), buffers_out: ti.template(), r, rank):
    """Order the reverse list of a grain by entry."""
    place = r * world.grains.capacity + rank
    if rank < world.replicas.released[r]:
        sort_run(buffers_out.partner_entry, buffers_out.start[place], buffers_out.stop[place])


@ti.func
def end_link(world: ti.template(), buffers_out: ti.template(), r, _):
    """From here on the reverse lists of replica r are valid."""
    buffers_out.faulty[r] = NO_FAULT
    buffers_out.linked[r] = 1


def link_stages(world: World, buffers: GrainBuffers) -> Stages:
    """Stages that make reverse lists.

    Entries are counted one by one, not grain by grain: an atomic operation in a loop of a thread is wrong on
    Mesa's software Vulkan driver (22.3.6).
    """
    grains, entries, chunks = world.grains.capacity, world.pairs.capacity, buffers.grain_chunks
    counted = ((begin_link, 1), (clear_partners, grains), (count_partner, entries))
    bounded = ((sum_partners, chunks), (bound_partners, chunks))
    return (*counted, *bounded, (note_partner, entries), (sort_partners, grains), (end_link, 1))
