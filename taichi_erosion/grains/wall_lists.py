"""Rebuilding the list of grains near walls, at the same moment as the neighbour list."""

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.contact import ROLLING_INERTIA
from taichi_erosion.grains.materials import pair_row
from taichi_erosion.grains.pairs import MEMORY, ROW_SHIFT, entry_block, partition_entries
from taichi_erosion.grains.state import partition_first, side_block
from taichi_erosion.grains.walls import into_wall_frame, surface_of, wall_distance, wall_offset

FAR = 1e30  # gap of a wall that is nowhere near [m]
ROUNDING = 1e-6  # of a length: what single precision may err by, with room [1]


@ti.func
def wall_gap(world: ti.template(), r, i, w):
    """Way [m] from the place where i is listed to where primitive w acts on it; far off a large number."""
    walls, grains = ti.static((world.walls, world.grains))
    s = surface_of(walls, w)
    near = grains.radius[i] + world.replicas.reach[r]
    gap = ti.cast(FAR, ti.f64)
    if walls.present[s] == 1:
        seen = into_wall_frame(walls, s, grains.origin[i])
        around = walls.size[w] + near + list_margin(world, r, i, w)
        if (seen - walls.middle[w]).norm_sqr() < around * around:
            gap = wall_distance(walls, w, wall_offset(walls, w, seen)) - near
    return gap


@ti.func
def list_margin(world: ti.template(), r, i, w):
    """Bound on how much nearer the grain at place i and primitive w may come before the next rebuild [m]."""
    allowed = ti.sqrt(world.grains.travel_squared[i])
    if world.walls.moving[surface_of(world.walls, w)] == 1:
        allowed += world.replicas.margin_most[r]
    return allowed


@ti.func
def recall_wall(world_out: ti.template(), r, e, rank, w):
    """Write entry e: its constants, and the memory that the grain had of primitive w."""
    grains, walls, entries_out = ti.static((world_out.grains, world_out.walls, world_out.wall_pairs))
    before = world_out.cells.order[r * grains.capacity + rank]
    old = side_block(grains, r, world_out.replicas.side[r]) + before
    row = pair_row(world_out.materials, r, grains.material[old], walls.material[surface_of(walls, w)])
    root, mass = ti.sqrt(grains.radius[old]), 1.0 / grains.mass_inverse[old]
    inertia = ROLLING_INERTIA * mass * grains.radius[old] * grains.radius[old]
    entries_out.root_radius[e] = root
    entries_out.damping[e] = world_out.materials.damping[row] * ti.sqrt(mass)
    entries_out.rolling_damping[e] = world_out.laws.rolling_constant(world_out.materials, row, root, inertia)
    entries_out.owner[e] = rank
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
def way_left(world: ti.template(), e, gap):
    """How far the grain of entry e may move before it can touch that wall [m]: not at all on a moving one."""
    walls, entries = ti.static((world.walls, world.wall_pairs))
    still = walls.moving[surface_of(walls, entries.wall[e])] == 0 and entries.label[e] & MEMORY == 0
    return ti.select(still, ti.max(ti.cast(gap, float), 0.0), 0.0)


@ti.func
def list_grain(world_out: ti.template(), r, rank, entry, limit):
    """List the walls near one grain from `entry` on; returns the number wanted."""
    walls, entries_out = ti.static((world_out.walls, world_out.wall_pairs))
    i = side_block(world_out.grains, r, 1 - world_out.replicas.side[r]) + rank
    clear = (1.0 - ROUNDING) * ti.sqrt(world_out.grains.travel_squared[i])
    wanted = 0
    for k in range(walls.primitives):
        w = r * walls.primitives + k
        gap = wall_gap(world_out, r, i, w)
        if gap < list_margin(world_out, r, i, w):
            if entry + wanted < limit:
                recall_wall(world_out, r, entry + wanted, rank, w)
                spare = gap - ROUNDING * world_out.grains.radius[i]
                clear = ti.min(clear, way_left(world_out, entry + wanted, spare))
            wanted += 1
    entries_out.clear_squared[i] = clear * clear
    return wanted


@ti.func
def list_walls(world_out: ti.template(), r, p):
    """Fill the wall lists of one partition; adds what did not fit to `Replicas.wall_short`."""
    entries_out, replicas_out = ti.static((world_out.wall_pairs, world_out.replicas))
    side = 1 - replicas_out.side[r]
    base = side_block(world_out.grains, r, side)
    first = partition_first(replicas_out, r, p)
    entry = entry_block(entries_out, r, side) + partition_entries(entries_out, replicas_out, r, p)
    limit = entry + entries_out.capacity // replicas_out.partitions[r]
    short = 0
    for rank in range(first, partition_first(replicas_out, r, p + 1)):
        wanted = list_grain(world_out, r, rank, entry, limit)
        listed = ti.min(wanted, limit - entry)
        short += wanted - listed
        entries_out.start[base + rank] = entry
        entry += listed
        entries_out.stop[base + rank] = entry
    replicas_out.wall_short[r, p] = short
