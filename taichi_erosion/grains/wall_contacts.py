"""Wall contacts: the list of grains near walls, rebuilt with the neighbour list, and the forces of walls.

A grain near a wall has an entry for every primitive within its skin. A primitive pushes only where its
closest point is a local minimum of the distance to its surface: an edge or corner shared by two primitives
counts once, and not at all where the contact lies inside one of them. When a grain passes from one primitive
of a surface to the next, the contact history moves to the next entry.
"""

from typing import Any

from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record
from taichi_erosion.grains.contact import ROLLING_INERTIA
from taichi_erosion.grains.materials import pair_row
from taichi_erosion.grains.neighbour_list import (
    ENGAGED,
    HISTORY,
    ROW_SHIFT,
    clear_history,
    partition_first_entry,
)
from taichi_erosion.grains.pair_contacts import contact_effect_force, do_pair_effects_act, report_deep_overlap
from taichi_erosion.grains.simd_batch import (
    evaluate_contact_law,
    lane,
    load_entry_to_lane,
    load_materials_row,
    set_lane_vector,
    store_history,
)
from taichi_erosion.grains.sleep import is_asleep
from taichi_erosion.grains.state import block, first_force_place, side_start
from taichi_erosion.grains.walls import (
    NO_SERVO,
    TORQUE,
    into_wall_frame,
    out_of_wall_frame,
    primitive_surface,
    servo_sum_place,
    surface_velocity,
    wall_distance,
    wall_offset,
)

SAME_POINT = 1e-6  # of the grain radius: closest points nearer than this are one point [1]


@device_record
class WallList:
    """Grains near walls: entries of all replicas, both sides, laid out as in `NeighbourList`."""

    capacity: int
    owner: Any  # i32, rank of the grain
    wall: Any  # i32, primitive, counted over all replicas
    label: Any  # i32, as in `NeighbourList`
    offset: Any  # f64 vec3, from the closest point of the wall to the grain, in the wall's frame [m]
    pushes: Any  # i32, 1 where the closest point is a local minimum
    root_radius: Any  # square root of the grain's radius [m^0.5]
    damping: Any  # as in `NeighbourList`
    rolling_damping: Any  # as in `NeighbourList`
    tangential_displacement: Any  # vec3, tangential displacement since engagement [m]
    rolling_displacement: Any  # vec3, rolling angle since engagement [rad]
    start: Any  # i32 by grain place
    stop: Any  # i32 by grain place
    clearance_squared: Any  # by grain place: square of the distance [m2] before it can touch a wall


def allocate_wall_list(replicas: int, grains: int, capacity: int) -> WallList:
    """Fields of `capacity` entries a replica and side."""
    entries = block(
        2 * replicas * capacity,
        i32="owner wall label pushes",
        real="root_radius damping rolling_damping",
        realx3="tangential_displacement rolling_displacement",
        f64x3="offset",
    )
    bounds = block(2 * replicas * grains, i32="start stop", real="clearance_squared")
    return WallList(capacity, **entries, **bounds)


@ti.func
def position_at(grains: ti.template(), i):
    """Position of the grain at place i [m], in f64."""
    return grains.origin[i] + ti.cast(grains.shift[i], ti.f64)


@ti.func
def position_in_wall_frame(world: ti.template(), i, e):
    """Position of the grain at place i in the frame of the wall of entry e [m]."""
    walls, entries = ti.static((world.walls, world.wall_pairs))
    return into_wall_frame(walls, primitive_surface(walls, entries.wall[e]), position_at(world.grains, i))


@ti.func
def is_local_minimum(world: ti.template(), i, e):
    """Whether the closest point of entry e is a local minimum of the distance to its surface.

    It is not where another primitive of the surface contains that point and comes closer elsewhere. Where
    both contain each other's closest point, as on a shared edge, the first of them pushes. All offsets are
    known.
    """
    walls, entries = ti.static((world.walls, world.wall_pairs))
    surface = walls.surface[entries.wall[e]]
    tolerance = SAME_POINT * world.grains.radius[i]
    position = position_in_wall_frame(world, i, e)
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
def locate_wall_contacts(world_out: ti.template(), i):
    """Closest points of all walls near the grain at place i, and which of them are local minima."""
    entries_out, walls = ti.static((world_out.wall_pairs, world_out.walls))
    for e in range(entries_out.start[i], entries_out.stop[i]):
        position = position_in_wall_frame(world_out, i, e)
        entries_out.offset[e] = wall_offset(walls, entries_out.wall[e], position)
    for e in range(entries_out.start[i], entries_out.stop[i]):
        entries_out.pushes[e] = 1
        if entries_out.start[i] + 1 < entries_out.stop[i]:
            entries_out.pushes[e] = is_local_minimum(world_out, i, e)


@ti.func
def transfer_wall_history(world_out: ti.template(), i):
    """Copy the history from the entry where a contact ended to that where it continues, within a surface."""
    surface, entries_out = ti.static((world_out.walls.surface, world_out.wall_pairs))
    for e in range(entries_out.start[i], entries_out.stop[i]):
        if entries_out.pushes[e] == 1 and entries_out.label[e] & ENGAGED == 0:
            for f in range(entries_out.start[i], entries_out.stop[i]):
                same = surface[entries_out.wall[f]] == surface[entries_out.wall[e]]
                if same and entries_out.pushes[f] == 0 and entries_out.label[f] & ENGAGED == ENGAGED:
                    entries_out.tangential_displacement[e] = entries_out.tangential_displacement[f]
                    entries_out.rolling_displacement[e] = entries_out.rolling_displacement[f]


@ti.func
def wall_effect_force(world_out: ti.template(), r, batch: ti.template(), n, i):
    """Force of the pair effects on the grain of lane n, at place i [N]; the wall counts as at rest."""
    (grains,) = ti.static((world_out.grains,))
    normal, radius = lane(batch.offset, n), batch.radius_i[n]
    place, closing = ti.cast(position_at(grains, i), float), -grains.velocity[i].dot(normal)
    j = world_out.pair_effects.wall_place
    return contact_effect_force(
        world_out, world_out.wall_pairs, batch, n, r, i, j, normal, place, closing, radius, 0.0
    )


@ti.func
def detect_wall(world_out: ti.template(), batch_out: ti.template(), n, r, base, e):
    """Write the wall contact of entry e to lane n; returns 1 where the grain is within reach, else 0.

    The column `offset` holds the normal.
    """
    grains, walls, entries_out = ti.static((world_out.grains, world_out.walls, world_out.wall_pairs))
    i, w = base + entries_out.owner[e], entries_out.wall[e]
    s = primitive_surface(walls, w)
    distance = wall_distance(walls, w, entries_out.offset[e])
    radius = grains.radius[i]
    near = walls.present[s] * entries_out.pushes[e]
    if near == 1 and distance < radius + world_out.replicas.reach[r]:
        normal = out_of_wall_frame(walls, s, entries_out.offset[e] * (1.0 / distance))
        point = position_at(grains, i) - distance * normal
        batch_out.entry[n] = e
        batch_out.owner[n] = entries_out.owner[e]
        batch_out.partner[n] = -1 - w
        batch_out.radius_i[n] = radius
        batch_out.radius_j[n] = 0.0
        batch_out.overlap[n] = ti.cast(ti.cast(radius, ti.f64) - distance, float)
        set_lane_vector(batch_out.offset, n, ti.cast(normal, float))
        velocity = ti.cast(surface_velocity(walls, s, point), float)
        set_lane_vector(batch_out.velocity, n, grains.velocity[i] - velocity)
        set_lane_vector(batch_out.spin_i, n, grains.spin[i])
        set_lane_vector(batch_out.spin_j, n, ti.cast(walls.spin[s], float))
    else:
        near = 0
        clear_history(entries_out, e)
    return near


@ti.func
def evaluate_wall(laws: ti.template(), batch_out: ti.template(), n, dt):
    """Contact law in lane n; the grain turns about a point of its own surface."""
    evaluate_contact_law(laws, batch_out, n, dt, lane(batch_out.offset, n), batch_out.overlap[n], 1.0)


@ti.func
def apply_wall_force(world_out: ti.template(), batch: ti.template(), n, r, p, base):
    rank, radius = batch.owner[n], batch.radius_i[n]
    report_deep_overlap(world_out.replicas, r, p, rank, batch.partner[n], batch.overlap[n], radius)
    force = add_wall_force(
        world_out, batch, n, r, base, first_force_place(world_out.grains, world_out.replicas, r, p)
    )
    if ti.static(world_out.walls.servos > 0):
        add_servo_push(world_out, batch, n, p, base, force)


@ti.func
def add_servo_push(world_out: ti.template(), batch: ti.template(), n, p, base, force):
    """Add a force on the grain in lane n [N] to what the servo of its wall reads."""
    (walls_out,) = ti.static((world_out.walls,))
    s = primitive_surface(walls_out, -1 - batch.partner[n])
    if walls_out.servo[s] != NO_SERVO:
        along = walls_out.axis[s]
        if walls_out.servo[s] == TORQUE:
            distance = ti.cast(batch.radius_i[n], ti.f64) - batch.overlap[n]
            point = position_at(world_out.grains, base + batch.owner[n]) - distance * lane(batch.offset, n)
            along = along.cross(point - walls_out.centre[s] - walls_out.shift[s])
        row = world_out.wall_pairs.label[batch.entry[n]] >> ROW_SHIFT
        width = batch.root_radius[n] * ti.sqrt(ti.max(batch.overlap[n], 0.0))
        place = servo_sum_place(walls_out, world_out.replicas, p, s)
        walls_out.push[place] = walls_out.push[place] - along.dot(force)
        stiff = 2.0 * world_out.materials.young[row] * width * along.norm_sqr()
        walls_out.stiffness[place] = walls_out.stiffness[place] + stiff


@ti.func
def add_wall_force(world_out: ti.template(), batch: ti.template(), n, r, base, buffer):
    """Add the force in lane n to the buffer of its grain, and store its history; returns the force [N]."""
    grains_out, entries_out = ti.static((world_out.grains, world_out.wall_pairs))
    e, rank, radius = batch.entry[n], batch.owner[n], batch.radius_i[n]
    place, total = buffer + rank, ti.Vector.zero(float, 3)
    if batch.acts[n] == 1:
        store_history(entries_out, batch, n)
        # until the next rebuild: a contact that ends is cleared at once
        entries_out.clearance_squared[base + rank] = 0.0
        total = lane(batch.force, n)
        grains_out.force[place] = grains_out.force[place] + total
        torque = lane(batch.moment, n) - radius * lane(batch.torque_per_radius, n)
        grains_out.torque[place] = grains_out.torque[place] + torque
    else:
        clear_history(entries_out, e)
    if ti.static(world_out.pair_effects.any):
        if do_pair_effects_act(world_out.materials, entries_out, e):
            pull = wall_effect_force(world_out, r, batch, n, base + rank)
            grains_out.force[place] = grains_out.force[place] + pull
            total += pull
    return total


@ti.func
def next_wall_entry(world_out: ti.template(), base, e, end):
    """First entry from e on whose grain may touch a wall; the contacts of that grain are located."""
    grains, entries = ti.static((world_out.grains, world_out.wall_pairs))
    entry = e
    clear = True
    while entry < end and clear:
        i = base + entries.owner[entry]
        if entry == entries.start[i]:
            clear = grains.shift[i].norm_sqr() < entries.clearance_squared[i]
            if ti.static(world_out.sleeps):
                clear = clear or is_asleep(world_out.sleep, i)
            if clear:
                entry = entries.stop[i]
            else:
                locate_wall_contacts(world_out, i)
                transfer_wall_history(world_out, i)
        else:
            clear = False
    return entry


@ti.func
def add_wall_forces(world_out: ti.template(), r, p):
    grains, entries, replicas = ti.static((world_out.grains, world_out.wall_pairs, world_out.replicas))
    base = side_start(grains, r, replicas.side[r])
    first, last = replicas.bounds[r, p], replicas.bounds[r, p + 1]
    dt = replicas.time_step[r]
    batch = world_out.batch_type()
    if first < last:
        e = entries.start[base + first]
        end = entries.stop[base + last - 1]
        while e < end:
            filled = 0
            while e < end and filled < world_out.lanes:
                e = next_wall_entry(world_out, base, e, end)
                if e < end:
                    filled += detect_wall(world_out, batch, filled, r, base, e)
                    e += 1
            for n in range(filled):
                load_entry_to_lane(world_out, world_out.wall_pairs, batch, n)
                load_materials_row(world_out, batch, n, entries.label[batch.entry[n]] >> ROW_SHIFT)
            for n in range(filled):
                evaluate_wall(world_out.laws, batch, n, dt)
            for n in range(filled):
                apply_wall_force(world_out, batch, n, r, p, base)


FAR = 1e30  # gap of a wall that is nowhere near [m]
ROUNDING = 1e-6  # of a length: what single precision may err by, with room [1]


@ti.func
def wall_gap(world: ti.template(), r, i, w):
    """Gap between the grain at place i, where it was listed, and the range of primitive w [m]."""
    walls, grains = ti.static((world.walls, world.grains))
    s = primitive_surface(walls, w)
    near = grains.radius[i] + world.replicas.reach[r]
    gap = ti.cast(FAR, ti.f64)
    if walls.present[s] == 1:
        local = into_wall_frame(walls, s, grains.origin[i])
        ball_reach = walls.ball_radius[w] + near + wall_approach_bound(world, r, i, w)
        if (local - walls.ball_centre[w]).norm_sqr() < ball_reach * ball_reach:
            gap = wall_distance(walls, w, wall_offset(walls, w, local)) - near
    return gap


@ti.func
def wall_approach_bound(world: ti.template(), r, i, w):
    """Bound on how much nearer the grain at place i and primitive w may come before the next rebuild [m]."""
    allowed = ti.sqrt(world.grains.skin_squared[i])
    if world.walls.moving[primitive_surface(world.walls, w)] == 1:
        allowed += world.replicas.skin_most[r]
    return allowed


@ti.func
def write_wall_entry(world_out: ti.template(), r, e, rank, w):
    """Write entry e: its constants, and the history of the grain with primitive w."""
    grains, walls, entries_out = ti.static((world_out.grains, world_out.walls, world_out.wall_pairs))
    before = world_out.cells.order[r * grains.capacity + rank]
    old = side_start(grains, r, world_out.replicas.side[r]) + before
    row = pair_row(world_out.materials, r, grains.material[old], walls.material[primitive_surface(walls, w)])
    root, mass = ti.sqrt(grains.radius[old]), 1.0 / grains.mass_inverse[old]
    inertia = ROLLING_INERTIA * mass * grains.radius[old] * grains.radius[old]
    entries_out.root_radius[e] = root
    entries_out.damping[e] = world_out.materials.damping[row] * ti.sqrt(mass)
    entries_out.rolling_damping[e] = world_out.laws.rolling_constant(world_out.materials, row, root, inertia)
    entries_out.owner[e] = rank
    entries_out.wall[e] = w
    entries_out.label[e] = row << ROW_SHIFT
    entries_out.tangential_displacement[e] = 0.0 * entries_out.tangential_displacement[e]
    entries_out.rolling_displacement[e] = 0.0 * entries_out.rolling_displacement[e]
    for f in range(entries_out.start[old], entries_out.stop[old]):
        if entries_out.wall[f] == w:
            entries_out.label[e] = (row << ROW_SHIFT) + (entries_out.label[f] & HISTORY)
            entries_out.tangential_displacement[e] = entries_out.tangential_displacement[f]
            entries_out.rolling_displacement[e] = entries_out.rolling_displacement[f]


@ti.func
def list_walls_of_grain(world_out: ti.template(), r, rank, entry, limit):
    """List the walls near one grain from `entry` on; returns the number of entries needed."""
    walls, entries_out = ti.static((world_out.walls, world_out.wall_pairs))
    i = side_start(world_out.grains, r, 1 - world_out.replicas.side[r]) + rank
    clear = (1.0 - ROUNDING) * ti.sqrt(world_out.grains.skin_squared[i])
    count = 0
    for k in range(walls.primitives):
        w = r * walls.primitives + k
        gap = wall_gap(world_out, r, i, w)
        if gap < wall_approach_bound(world_out, r, i, w):
            if entry + count < limit:
                e = entry + count
                write_wall_entry(world_out, r, e, rank, w)
                # beside a wall that moves, or that the grain touches, no way is clear
                still = walls.moving[primitive_surface(walls, w)] == 0 and entries_out.label[e] & HISTORY == 0
                spare = ti.cast(gap - ROUNDING * world_out.grains.radius[i], float)
                clear = ti.min(clear, ti.select(still, ti.max(spare, 0.0), 0.0))
            count += 1
    entries_out.clearance_squared[i] = clear * clear
    return count


@ti.func
def list_walls_of_partition(world_out: ti.template(), r, p):
    """Fill the wall lists of one partition; `Replicas.wall_short` counts the entries that did not fit."""
    entries_out, replicas_out = ti.static((world_out.wall_pairs, world_out.replicas))
    side = 1 - replicas_out.side[r]
    base = side_start(world_out.grains, r, side)
    entry = side_start(entries_out, r, side) + partition_first_entry(entries_out, replicas_out, r, p)
    limit = entry + entries_out.capacity // replicas_out.partitions[r]
    short = 0
    for rank in range(replicas_out.bounds[r, p], replicas_out.bounds[r, p + 1]):
        count = list_walls_of_grain(world_out, r, rank, entry, limit)
        listed = ti.min(count, limit - entry)
        short += count - listed
        entries_out.start[base + rank] = entry
        entry += listed
        entries_out.stop[base + rank] = entry
    replicas_out.wall_short[r, p] = short
