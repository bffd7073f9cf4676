"""Contacts between grains and walls.

A grain near a wall keeps an entry for every primitive within its list margin. A primitive pushes only where
its closest point is a local minimum of the distance to its surface: an edge or corner shared by two
primitives counts once, and not at all where one of them is met on its inside. When a grain passes from one
primitive of a surface to the next, the memory of the contact goes with it.
"""

from dataclasses import dataclass
from typing import Any

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.contact import ROLLING_INERTIA, contact_force, describe_contact
from taichi_erosion.grains.pair_contacts import (
    acted_on,
    forget,
    hold,
    remember,
    report_overlap,
    touch_stiffness,
)
from taichi_erosion.grains.pairs import ENGAGED, ROW_SHIFT
from taichi_erosion.grains.sleep import is_asleep
from taichi_erosion.grains.state import force_block, partition_first, side_block
from taichi_erosion.grains.walls import (
    into_wall_frame,
    surface_of,
    surface_velocity,
    wall_distance,
    wall_offset,
)

SAME_POINT = 1e-6  # of the grain radius: closest points nearer than this are one point [1]


@dataclass(frozen=True, eq=False)
class WallPairs:
    """Grains near walls: entries of all replicas, both sides, laid out as in `Pairs`."""

    capacity: int
    owner: Any  # i32, rank of the grain
    wall: Any  # i32, primitive, counted over all replicas
    label: Any  # i32, as in `Pairs`
    offset: Any  # f64 vec3, from the closest point of the wall to the grain, in the wall's frame [m]
    pushes: Any  # i32, whether the closest point is one where the surface pushes
    slip: Any  # vec3, tangential displacement since engagement [m]
    tilt: Any  # vec3, rolling angle since engagement [rad]
    start: Any  # i32 by grain place
    stop: Any  # i32 by grain place
    clear_squared: Any  # by grain place: square of the way [m2] that the grain has before it can touch a wall


def allocate_wall_pairs(replicas: int, grains: int, capacity: int) -> WallPairs:
    """Fields of `capacity` entries a replica and side."""
    entries: dict[str, Any] = {name: ti.field(ti.i32) for name in ("owner", "wall", "label", "pushes")}
    entries |= {name: ti.Vector.field(3, float) for name in ("slip", "tilt")}
    entries["offset"] = ti.Vector.field(3, ti.f64)
    ti.root.dense(ti.i, 2 * replicas * capacity).place(*entries.values())
    bounds: dict[str, Any] = {name: ti.field(ti.i32) for name in ("start", "stop")}
    bounds["clear_squared"] = ti.field(float)
    ti.root.dense(ti.i, 2 * replicas * grains).place(*bounds.values())
    return WallPairs(capacity, **entries, **bounds)


@ti.func
def position_at(grains: ti.template(), i):
    """Position of the grain at place i [m], in f64."""
    return grains.origin[i] + ti.cast(grains.shift[i], ti.f64)


@ti.func
def seen_from(world: ti.template(), i, e):
    """Position of the grain at place i in the frame of the wall of entry e [m]."""
    walls, entries = ti.static((world.walls, world.wall_pairs))
    return into_wall_frame(walls, surface_of(walls, entries.wall[e]), position_at(world.grains, i))


@ti.func
def is_local_minimum(world: ti.template(), i, e):
    """Whether the closest point of entry e is one where its surface pushes; all offsets must be known.

    It is not where another primitive of the surface holds that point and comes closer elsewhere. Where both
    hold each other's closest point, as on an edge that they share, the first of them pushes.
    """
    walls, entries = ti.static((world.walls, world.wall_pairs))
    surface = walls.surface[entries.wall[e]]
    tolerance = SAME_POINT * world.grains.radius[i]
    position = seen_from(world, i, e)
    farthest = entries.offset[e].norm() + tolerance
    minimum = 1
    for f in range(entries.start[i], entries.stop[i]):
        if f != e and walls.surface[entries.wall[f]] == surface and entries.offset[f].norm() < farthest:
            if wall_offset(walls, entries.wall[f], position - entries.offset[e]).norm() < tolerance:
                back = wall_offset(walls, entries.wall[e], position - entries.offset[f]).norm()
                if f < e or back >= tolerance:
                    minimum = 0
    return minimum


@ti.func
def locate_contacts(world_out: ti.template(), i):
    """Closest points of all walls near the grain at place i, and which of them push."""
    entries_out, walls = ti.static((world_out.wall_pairs, world_out.walls))
    for e in range(entries_out.start[i], entries_out.stop[i]):
        entries_out.offset[e] = wall_offset(walls, entries_out.wall[e], seen_from(world_out, i, e))
    for e in range(entries_out.start[i], entries_out.stop[i]):
        entries_out.pushes[e] = 1
        if entries_out.start[i] + 1 < entries_out.stop[i]:
            entries_out.pushes[e] = is_local_minimum(world_out, i, e)


@ti.func
def hand_over(world_out: ti.template(), i):
    """Pass memory from the entry where a contact ended to the one where it goes on, within a surface."""
    surface, entries_out = ti.static((world_out.walls.surface, world_out.wall_pairs))
    for e in range(entries_out.start[i], entries_out.stop[i]):
        if entries_out.pushes[e] == 1 and entries_out.label[e] & ENGAGED == 0:
            for f in range(entries_out.start[i], entries_out.stop[i]):
                same = surface[entries_out.wall[f]] == surface[entries_out.wall[e]]
                if same and entries_out.pushes[f] == 0 and entries_out.label[f] & ENGAGED == ENGAGED:
                    entries_out.slip[e] = entries_out.slip[f]
                    entries_out.tilt[e] = entries_out.tilt[f]


@ti.func
def act_on_wall(world_out: ti.template(), r, i, e, normal, speed, elastic):
    """Force [N] and torque [N m] on the grain of an acting contact; `speed` is the wall's there [m s-1]."""
    grains, entries_out, materials = ti.static((world_out.grains, world_out.wall_pairs, world_out.materials))
    row = entries_out.label[e] >> ROW_SHIFT
    radius = grains.radius[i]
    mass = 1.0 / grains.mass_inverse[i]
    root = ti.sqrt(radius)
    rolling = world_out.laws.rolling_constant(materials, row, root, ROLLING_INERTIA * mass * radius * radius)
    constants = (root, materials.damping[row] * ti.sqrt(mass), rolling)
    velocity = grains.velocity[i] - speed - radius * grains.spin[i].cross(normal)
    spin = ti.cast(world_out.walls.spin[surface_of(world_out.walls, entries_out.wall[e])], float)
    touch = describe_contact(world_out.laws, normal, velocity, grains.spin[i] - spin, constants, elastic)
    dt = world_out.replicas.time_step[r]
    force, tangential, moment, slip, tilt = contact_force(
        world_out.laws, materials, row, touch, entries_out.slip[e], entries_out.tilt[e], dt
    )
    remember(entries_out, e, slip, tilt)
    entries_out.clear_squared[i] = 0.0  # until the next rebuild: what ended must be forgotten at once
    return force, moment - radius * normal.cross(tangential)


@ti.func
def pull_to_wall(world_out: ti.template(), r, i, e, normal, gap):
    """Force on the grain by the effects [N]; the wall counts as at rest."""
    (grains,) = ti.static((world_out.grains,))
    radius = grains.radius[i]
    row = world_out.wall_pairs.label[e] >> ROW_SHIFT
    pair = world_out.pair_type(
        gap=gap,
        radius_i=radius,
        radius_j=0.0,
        radius_effective=radius,
        mass_i=1.0 / grains.mass_inverse[i],
        mass_j=0.0,
        closing_speed=-grains.velocity[i].dot(normal),
        stiffness=touch_stiffness(world_out.materials, row, ti.sqrt(radius), -gap),
        met=0.0,
    )
    return -hold(world_out.pair_effects, world_out.wall_pairs, r, e, pair) * normal


@ti.func
def wall_force(world_out: ti.template(), r, p, base, i, e):
    """Force [N] and torque [N m] of one wall entry on its grain."""
    grains, walls, entries_out = ti.static((world_out.grains, world_out.walls, world_out.wall_pairs))
    w = entries_out.wall[e]
    s = surface_of(walls, w)
    distance = wall_distance(walls, w, entries_out.offset[e])
    radius = grains.radius[i]
    force = 0.0 * grains.velocity[i]
    torque = force
    acts = 0
    if walls.present[s] * entries_out.pushes[e] == 1 and distance < radius + world_out.replicas.reach[r]:
        overlap = ti.cast(ti.cast(radius, ti.f64) - distance, float)
        label = entries_out.label[e]
        report_overlap(world_out.replicas, r, p, (i - base, -1 - w), overlap, radius)
        root = ti.sqrt(radius)
        row, engaged = label >> ROW_SHIFT, label & ENGAGED
        elastic = world_out.laws.normal_force(world_out.materials, row, overlap, root, engaged)
        acts = elastic[3]
        exact = walls.turn[s] @ (entries_out.offset[e] * (1.0 / distance))
        normal = ti.cast(exact, float)
        if acts == 1:
            there = position_at(grains, i) - distance * exact
            speed = ti.cast(surface_velocity(walls, s, there), float)
            force, torque = act_on_wall(world_out, r, i, e, normal, speed, elastic)
        if ti.static(world_out.pair_effects.any):
            if acted_on(world_out.materials, entries_out, e):
                force += pull_to_wall(world_out, r, i, e, normal, -overlap)
    if acts == 0:
        forget(entries_out, e)
    return force, torque


@ti.func
def add_wall_force(world_out: ti.template(), r, p, rank):
    """Forces of all walls near one grain."""
    grains_out, entries, replicas = ti.static((world_out.grains, world_out.wall_pairs, world_out.replicas))
    base = side_block(grains_out, r, replicas.side[r])
    place = force_block(grains_out, replicas, r, p) + rank
    i = base + rank
    locate_contacts(world_out, i)
    hand_over(world_out, i)
    for e in range(entries.start[i], entries.stop[i]):
        force, torque = wall_force(world_out, r, p, base, i, e)
        grains_out.force[place] = grains_out.force[place] + force
        grains_out.torque[place] = grains_out.torque[place] + torque


@ti.func
def add_wall_forces(world_out: ti.template(), r, p):
    """Forces of all walls on the grains of one partition; those that cannot touch one yet are left out."""
    grains, entries, replicas = ti.static((world_out.grains, world_out.wall_pairs, world_out.replicas))
    base = side_block(grains, r, replicas.side[r])
    count = replicas.released[r]
    first = partition_first(count, replicas.partitions[r], p)
    last = partition_first(count, replicas.partitions[r], p + 1)
    if first < last:
        e = entries.start[base + first]
        end = entries.stop[base + last - 1]
        while e < end:
            rank = entries.owner[e]
            i = base + rank
            due = grains.shift[i].norm_sqr() >= entries.clear_squared[i]
            if ti.static(world_out.sleeps):
                due = due and not is_asleep(world_out.sleep, i)
            if due:
                add_wall_force(world_out, r, p, rank)
            e = entries.stop[i]
