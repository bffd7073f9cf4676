"""Neighbour list (Verlet list): pairs that may touch before the next rebuild, with their contact history.

Half list: a pair has one entry, at the grain whose cell comes first. Entries of a grain lie together from
`start` to `stop`, touching pairs first, so that the force loop has them in runs. Every replica has
`capacity` entries on each of two sides; each partition of its grains fills its own share of them, so
partitions never wait for each other.

In the grain decomposition entry k of a grain stands `stride` places behind entry k - 1, beside entry k of the
next grain: neighbouring threads read neighbouring places, and pairs that touch fill whole groups of threads.

The Verlet skin h is the distance that a grain may move before the lists are rebuilt:

    h = clip(|v| t, m R, h_most)

Fast grains have a wide skin, resting grains a narrow one, so that a few flying grains do not force rebuilds
on the settled ones. Adjacent cells hold all partners of a grain with R + h <= L, the reach of the cells. A
wide grain, R + h > L, is searched in a larger box of cells instead. That costs little while such grains are
few; in a crowd of them the skin is limited to h = max(m R, L - R).
"""

from typing import Any

from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record
from taichi_erosion.grains.state import block, side_start

ENGAGED = 1  # bit of a label: the contact acts
MET = 2  # bit of a label: the two have touched, and an effect has attracted them since
HISTORY = ENGAGED | MET
ROW_SHIFT = 2  # of a label: above these bits stands the row of Materials
WIDE_MOST = 150  # wide grains, beyond which they are a crowd, in a replica of few
CROWD = 40  # likewise one in so many, in a replica of many: the search takes twice as long with these


@device_record
class NeighbourList:
    """Entries of all replicas, both sides."""

    capacity: int  # entries a replica and side
    stride: int  # places from one entry of a grain to the next
    owner: Any  # i32, rank of the owner
    neighbour: Any  # i32, rank of the partner
    label: Any  # i32, row of Materials above the bits ENGAGED and MET
    separation: Any  # vec3, origin of the owner minus origin of the partner [m]
    root_radius: Any  # square root of the effective radius [m^0.5]
    damping: Any  # normal damping constant over sqrt(a) [kg s-1 m-0.5]
    rolling_damping: Any  # rolling damping constant over sqrt(a) [N m s m-0.5]
    tangential_displacement: Any  # vec3, tangential displacement since engagement [m]
    rolling_displacement: Any  # vec3, rolling angle since engagement [rad]
    start: Any  # i32 by grain place: first entry
    stop: Any  # i32 by grain place: one past the last entry


def allocate_neighbour_list(replicas: int, grains: int, capacity: int, stride: int) -> NeighbourList:
    """Fields of `capacity` entries a replica and side."""
    places = 2 * replicas * capacity
    # apart from the rest: the search for a pair in an old list reads nothing else
    names = block(places, i32="owner neighbour label")
    entries = block(
        places,
        realx3="separation tangential_displacement rolling_displacement",
        real="root_radius damping rolling_damping",
    )
    return NeighbourList(
        capacity, stride, **names, **entries, **block(2 * replicas * grains, i32="start stop")
    )


@ti.func
def entry_count(pairs: ti.template(), i):
    return (pairs.stop[i] - pairs.start[i]) // pairs.stride


@ti.func
def partition_first_entry(pairs: ti.template(), replicas: ti.template(), r, p):
    """First entry of partition p within a side."""
    return pairs.capacity // replicas.partitions[r] * p


@ti.func
def clear_history(entries_out: ti.template(), e):
    """Clear the history of a contact that has ended; `entries_out` is a neighbour list or a wall list."""
    if entries_out.label[e] & ENGAGED == ENGAGED:
        entries_out.label[e] = entries_out.label[e] - ENGAGED
        entries_out.tangential_displacement[e] = 0.0 * entries_out.tangential_displacement[e]
        entries_out.rolling_displacement[e] = 0.0 * entries_out.rolling_displacement[e]


@ti.func
def unlimited_skin(replicas: ti.template(), r, radius, speed):
    """Skin of a grain without regard to cells [m]."""
    least = replicas.skin_least[r] * radius
    return ti.min(ti.max(least, speed * replicas.skin_time[r]), replicas.skin_most[r])


@ti.func
def verlet_skin(replicas: ti.template(), r, radius, speed):
    """Verlet skin of a grain [m]; in a crowd of wide grains no more than cells allow."""
    allowed = unlimited_skin(replicas, r, radius, speed)
    if replicas.crowded[r] == 1:
        least = replicas.skin_least[r] * radius
        allowed = ti.min(allowed, ti.max(least, replicas.cell_reach[r] - radius))
    return allowed


@ti.func
def count_wide_grains(world_out: ti.template(), r):
    """Set `crowded` where too many grains want skins that reach beyond adjacent cells."""
    grains, replicas_out = ti.static((world_out.grains, world_out.replicas))
    base = side_start(grains, r, replicas_out.side[r])
    wide = 0
    for i in range(base, base + replicas_out.released[r]):
        radius = grains.radius[i]
        width = unlimited_skin(replicas_out, r, radius, grains.velocity[i].norm())
        wide += ti.cast(radius + width > replicas_out.cell_reach[r], ti.i32)
    replicas_out.crowded[r] = ti.cast(wide > ti.max(WIDE_MOST, replicas_out.released[r] // CROWD), ti.i32)


@ti.func
def is_wide_grain(world: ti.template(), r, i):
    """Whether the grain at place i reaches beyond adjacent cells."""
    return world.grains.extent[i] > world.replicas.cell_reach[r]
