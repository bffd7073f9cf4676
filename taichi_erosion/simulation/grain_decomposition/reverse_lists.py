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
def count_partners(world: ti.template(), buffers_out: ti.template(), r, rank):
    """Count the entries of a grain at their second grains."""
    i, row = side_block(world.grains, r, world.replicas.side[r]) + rank, r * world.grains.capacity
    if rank < world.replicas.released[r]:
        for e in range(world.pairs.start[i], world.pairs.stop[i]):
            ti.atomic_add(buffers_out.start[row + world.pairs.neighbour[e]], 1)


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
def note_partners(world: ti.template(), buffers_out: ti.template(), r, rank):
    """Write the entries of a grain to the reverse lists of their second grains."""
    side = world.replicas.side[r]
    i, row = side_block(world.grains, r, side) + rank, r * world.grains.capacity
    if rank < world.replicas.released[r]:
        for e in range(world.pairs.start[i], world.pairs.stop[i]):
            place = ti.atomic_add(buffers_out.stop[row + world.pairs.neighbour[e]], 1)
            buffers_out.partner_entry[place] = e - entry_block(world.pairs, r, side)


@ti.func
def sort_partners(world: ti.template(), buffers_out: ti.template(), r, rank):
    """Order the reverse list of a grain by entry."""
    place = r * world.grains.capacity + rank
    if rank < world.replicas.released[r]:
        sort_run(buffers_out.partner_entry, buffers_out.start[place], buffers_out.stop[place])


@ti.func
def end_link(world: ti.template(), buffers_out: ti.template(), r, _):
    """Number of entries of replica r; from here on its reverse lists are valid."""
    side, released = world.replicas.side[r], world.replicas.released[r]
    last = side_block(world.grains, r, side) + released - 1
    listed = 0
    if released > 0:
        listed = world.pairs.stop[last] - entry_block(world.pairs, r, side)
    buffers_out.listed[r] = listed
    buffers_out.faulty[r] = NO_FAULT
    buffers_out.linked[r] = 1


def link_stages(world: World, buffers: GrainBuffers) -> Stages:
    """Stages that make reverse lists."""
    grains, chunks = world.grains.capacity, buffers.grain_chunks
    counted = ((clear_partners, grains), (count_partners, grains))
    bounded = ((sum_partners, chunks), (join_partners, 1), (bound_partners, chunks), (begin_filling, grains))
    return (*counted, *bounded, (note_partners, grains), (sort_partners, grains), (end_link, 1))
