"""Reverse lists: for every grain the entries of the neighbour lists in which it is the second of the pair."""

from taichi_erosion.core.ti import ti
from taichi_erosion.grains import World
from taichi_erosion.grains.neighbour_list import entry_block
from taichi_erosion.grains.state import side_block
from taichi_erosion.simulation.grain_decomposition.buffers import (
    NO_FAULT,
    GrainBuffers,
    Stages,
    chunk_bounds,
    sort_run,
    sum_chunk,
    sum_chunks_before,
)


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
def join_partners(world: ti.template(), buffers_out: ti.template(), r, _):
    """Entries before every chunk of grains."""
    sum_chunks_before(buffers_out.pair_sums, r * buffers_out.grain_chunks, buffers_out.grain_chunks)


@ti.func
def bound_partners(world: ti.template(), buffers_out: ti.template(), r, k):
    """First places in the reverse lists of one chunk of grains."""
    first, place = r * world.grains.capacity, r * buffers_out.grain_chunks
    count, size = world.replicas.released[r], buffers_out.grain_chunk
    base = r * world.pairs.capacity
    chunk_bounds(buffers_out.start, buffers_out.pair_sums, first, count, place, k, size, base)


@ti.func
def begin_filling(world: ti.template(), buffers_out: ti.template(), r, rank):
    """Let the reverse list of a grain end where it begins."""
    place = r * world.grains.capacity + rank
    buffers_out.stop[place] = buffers_out.start[place]


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
    bounded = ((sum_partners, chunks), (join_partners, 1), (bound_partners, chunks), (begin_filling, grains))
    return (*counted, *bounded, (note_partner, entries), (sort_partners, grains), (end_link, 1))
