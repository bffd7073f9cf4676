"""Rebuilding the list of grains near walls, at the same moment as the neighbour list."""

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.materials import pair_row
from taichi_erosion.grains.pairs import MEMORY, ROW_SHIFT, entry_block, partition_entries
from taichi_erosion.grains.state import partition_first, side_block
from taichi_erosion.grains.walls import into_wall_frame, surface_of, wall_distance, wall_offset


@ti.func
def is_near(world: ti.template(), r, i, w):
    """Whether the grain at place i may touch primitive w before the next rebuild."""
    walls, grains, replicas = ti.static((world.walls, world.grains, world.replicas))
    s = surface_of(walls, w)
    allowed = grains.radius[i] + ti.sqrt(grains.travel_squared[i]) + replicas.reach[r]
    if walls.moving[s] == 1:
        allowed += replicas.margin_most[r]
    near = False
    if walls.present[s] == 1:
        seen = into_wall_frame(walls, s, grains.origin[i])
        around = walls.size[w] + allowed
        if (seen - walls.middle[w]).norm_sqr() < around * around:
            near = wall_distance(walls, w, wall_offset(walls, w, seen)) < allowed
    return near


@ti.func
def recall_wall(world_out: ti.template(), r, e, rank, w):
    """Write entry e with the memory that the grain had of primitive w."""
    grains, walls, entries_out = ti.static((world_out.grains, world_out.walls, world_out.wall_pairs))
    before = world_out.cells.order[r * grains.capacity + rank]
    old = side_block(grains, r, world_out.replicas.side[r]) + before
    row = pair_row(world_out.materials, r, grains.material[old], walls.material[surface_of(walls, w)])
    entries_out.wall[e] = w
    entries_out.label[e] = row << ROW_SHIFT
    entries_out.slip[e] = 0.0 * entries_out.slip[e]
    entries_out.tilt[e] = 0.0 * entries_out.tilt[e]
    for f in range(entries_out.start[old], entries_out.stop[old]):
        if entries_out.wall[f] == w:
            entries_out.label[e] = (row << ROW_SHIFT) + (entries_out.label[f] & MEMORY)
            entries_out.slip[e] = entries_out.slip[f]
            entries_out.tilt[e] = entries_out.tilt[f]


@ti.func
def list_walls(world_out: ti.template(), r, p):
    """Fill the wall lists of one partition; adds what did not fit to `Replicas.wall_short`."""
    walls, entries_out, replicas_out = ti.static((world_out.walls, world_out.wall_pairs, world_out.replicas))
    side = 1 - replicas_out.side[r]
    base = side_block(world_out.grains, r, side)
    count = replicas_out.released[r]
    first = partition_first(count, replicas_out.partitions[r], p)
    entry = entry_block(entries_out, r, side) + partition_entries(entries_out, replicas_out, r, p)
    limit = entry + entries_out.capacity // replicas_out.partitions[r]
    short = 0
    for rank in range(first, partition_first(count, replicas_out.partitions[r], p + 1)):
        entries_out.start[base + rank] = entry
        for k in range(walls.primitives):
            w = r * walls.primitives + k
            if is_near(world_out, r, base + rank, w):
                if entry < limit:
                    recall_wall(world_out, r, entry, rank, w)
                    entry += 1
                else:
                    short += 1
        entries_out.stop[base + rank] = entry
    replicas_out.wall_short[r, p] = short
