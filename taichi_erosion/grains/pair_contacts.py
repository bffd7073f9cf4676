"""Pair forces: each partition loops over its half list and adds to both partners in its own force buffer.

Pairs within reach fill the lanes of a batch (`grains.simd_batch`), the contact law runs over all lanes, and
the forces are scattered to the grains.
"""

from taichi_erosion.core.effect_device import any_lets_pass, total_attraction, total_vector_force
from taichi_erosion.core.ti import ti
from taichi_erosion.grains.cells import wrapped_position
from taichi_erosion.grains.neighbour_list import ENGAGED, MET, ROW_SHIFT, clear_history
from taichi_erosion.grains.simd_batch import (
    evaluate_contact_law,
    lane,
    load_entry_to_lane,
    load_materials_row,
    set_lane_vector,
    store_history,
)
from taichi_erosion.grains.sleep import first_awake_entry, record_sleep_change
from taichi_erosion.grains.state import first_force_place, side_start

MULTIPLIER = 0x9E3779B1  # golden ratio of 32 bits, odd (Knuth 1998, Art of Computer Programming 3, sec. 6.4)
STIR, UNIT = 0x85EBCA6B, 2.0**-32  # odd, from the finaliser of MurmurHash3; of a 32-bit number


@ti.func
def is_overlap_too_deep(replicas: ti.template(), r, overlap, size):
    """Whether an overlap is beyond the limit, which is a share of `size` [m]."""
    return overlap > replicas.overlap_limit[r] * size


@ti.func
def report_deep_overlap(replicas_out: ti.template(), r, p, rank, partner, overlap, size):
    """Record the first overlap of this partition beyond the limit, which is a share of `size` [m]."""
    if is_overlap_too_deep(replicas_out, r, overlap, size) and replicas_out.fault_value[r, p] == 0.0:
        replicas_out.fault_value[r, p] = overlap / size
        replicas_out.fault_grain[r, p] = rank
        replicas_out.fault_partner[r, p] = partner


@ti.func
def do_pair_effects_act(materials: ti.template(), entries: ti.template(), e):
    return materials.effects[entries.label[e] >> ROW_SHIFT] > 0.0


@ti.func
def contact_effect_force(
    world_out: ti.template(),
    entries_out: ti.template(),
    batch: ti.template(),
    n,
    r,
    i,
    j,
    normal,
    offset,
    closing_speed,
    radius_effective,
    mass_j,
):
    """Force of the pair effects on place i of the contact in lane n [N]; MET holds until attraction ends."""
    (bound,) = ti.static((world_out.pair_effects,))
    e, overlap, root = batch.entry[n], batch.overlap[n], batch.root_radius[n]
    if overlap >= 0.0:
        entries_out.label[e] = entries_out.label[e] | MET
    row = entries_out.label[e] >> ROW_SHIFT
    pair = world_out.pair_type(
        gap=-overlap,
        radius_i=batch.radius_i[n],
        radius_j=batch.radius_j[n],
        radius_effective=radius_effective,
        mass_i=1.0 / world_out.grains.mass_inverse[i],
        mass_j=mass_j,
        closing_speed=closing_speed,
        # of a Hertz contact, 2 E* a
        stiffness=2.0 * world_out.materials.young[row] * root * ti.sqrt(ti.max(overlap, 0.0)),
        touched=ti.cast((entries_out.label[e] & MET) / MET, float),
        normal=normal,
        offset=offset,
        period=ti.cast(world_out.replicas.period[r], float),
    )
    pull = total_attraction(bound, r, pair, i, j)
    if pair.gap > 0.0 and pull == 0.0:
        entries_out.label[e] = entries_out.label[e] & ~MET
    force = -pull * normal
    if ti.static(bound.any_vector):
        force += total_vector_force(bound, r, pair, i, j)
    return force


@ti.func
def pair_effect_force(world_out: ti.template(), batch: ti.template(), n, r, base):
    """Force of the pair effects on the first grain of lane n [N]; the second has its opposite."""
    i, j, offset = base + batch.owner[n], base + batch.partner[n], lane(batch.offset, n)
    normal, root = offset.normalized(), batch.root_radius[n]
    closing, mass_j = -lane(batch.velocity, n).dot(normal), 1.0 / world_out.grains.mass_inverse[j]
    return contact_effect_force(
        world_out, world_out.pairs, batch, n, r, i, j, normal, offset, closing, root * root, mass_j
    )


@ti.func
def pair_random_number(first, second):
    """Uniform random number in [0, 1) that belongs to a pair of grains, in either order."""
    low, high = ti.cast(ti.min(first, second), ti.u32), ti.cast(ti.max(first, second), ti.u32)
    key = (low * ti.u32(MULTIPLIER) + high) * ti.u32(STIR)
    key = (key ^ (key >> ti.u32(15))) * ti.u32(MULTIPLIER)
    return ti.cast(key ^ (key >> ti.u32(16)), float) * UNIT


@ti.func
def do_pass_through_each_other(world: ti.template(), r, e, i, j, overlap):
    """Whether the overlapping grains at places i and j pass through each other."""
    grains, replicas = ti.static((world.grains, world.replicas))
    free = 0
    # an engaged contact stays engaged
    if world.pairs.label[e] & ENGAGED == 0 and overlap > 0.0:
        first, second = wrapped_position(grains, replicas, r, i), wrapped_position(grains, replicas, r, j)
        contact = world.first_contact_type(
            height=ti.cast(ti.min(first[2], second[2]), float),
            depth=overlap / world.pairs.root_radius[e] ** 2,
            chance=pair_random_number(grains.ident[i], grains.ident[j]),
        )
        free = any_lets_pass(world.first_contact_effects, r, contact)
    return free


@ti.func
def load_shared_material_row(world: ti.template(), batch_out: ti.template(), row):
    """Load the row of Materials that all pairs share to all lanes; nothing where it is -1."""
    if row >= 0:
        for n in range(world.lanes):
            load_materials_row(world, batch_out, n, row)


@ti.func
def load_pair_to_lane(world: ti.template(), batch_out: ti.template(), n, base, row):
    """Load what the contact law reads of the pair in lane n; `row` is that of `load_shared_material_row`."""
    grains, pairs = ti.static((world.grains, world.pairs))
    i, j = base + batch_out.owner[n], base + batch_out.partner[n]
    batch_out.radius_i[n] = grains.radius[i]
    batch_out.radius_j[n] = grains.radius[j]
    load_entry_to_lane(world, pairs, batch_out, n)
    if row < 0:
        load_materials_row(world, batch_out, n, pairs.label[batch_out.entry[n]] >> ROW_SHIFT)
    set_lane_vector(batch_out.velocity, n, grains.velocity[i] - grains.velocity[j])
    set_lane_vector(batch_out.spin_i, n, grains.spin[i])
    set_lane_vector(batch_out.spin_j, n, grains.spin[j])


@ti.func
def evaluate_pair_law(laws: ti.template(), batch_out: ti.template(), n, dt):
    """Contact law in lane n.

    Both grains turn about one point of contact, which keeps the angular momentum of the pair; the lever is
    the distance of the centres over the sum of the radii [1].
    """
    offset = lane(batch_out.offset, n)
    span = batch_out.radius_i[n] + batch_out.radius_j[n]
    distance = offset.norm()
    evaluate_contact_law(laws, batch_out, n, dt, offset * (1.0 / distance), span - distance, distance / span)


@ti.func
def pair_torques(batch: ti.template(), n):
    """Torque on the first grain of lane n, and the opposite of that on the second [N m]."""
    moment, twist = lane(batch.moment, n), lane(batch.torque_per_radius, n)
    return moment - batch.radius_i[n] * twist, moment + batch.radius_j[n] * twist


@ti.func
def add_pair_force(world_out: ti.template(), batch: ti.template(), n, buffer):
    """Add the contact force in lane n to both grains, and store its history."""
    (grains_out,) = ti.static((world_out.grains,))
    action, reaction = buffer + batch.owner[n], buffer + batch.partner[n]
    force = lane(batch.force, n)
    torque, back = pair_torques(batch, n)
    store_history(world_out.pairs, batch, n)
    grains_out.force[action] = grains_out.force[action] + force
    grains_out.torque[action] = grains_out.torque[action] + torque
    grains_out.force[reaction] = grains_out.force[reaction] - force
    grains_out.torque[reaction] = grains_out.torque[reaction] - back


@ti.func
def load_pair_within_reach(world_out: ti.template(), batch_out: ti.template(), n, r, e, base):
    """Write the pair of entry e to lane n; returns 1 where its grains are within reach, else 0.

    The lane is written in any case: a branch that goes either way at random costs more.
    """
    grains, pairs_out = ti.static((world_out.grains, world_out.pairs))
    owner, partner = pairs_out.owner[e], pairs_out.neighbour[e]
    i, j = base + owner, base + partner
    offset = pairs_out.separation[e] + grains.shift[i] - grains.shift[j]
    reach = grains.radius[i] + grains.radius[j]
    if ti.static(world_out.laws.adhesive or world_out.pair_effects.any):
        reach += world_out.replicas.reach[r]
    batch_out.entry[n] = e
    batch_out.owner[n] = owner
    batch_out.partner[n] = partner
    set_lane_vector(batch_out.offset, n, offset)
    distance_squared = offset.norm_sqr()
    near = ti.cast(distance_squared < reach * reach, ti.i32)
    if ti.static(world_out.first_contact_effects.any):
        overlap = grains.radius[i] + grains.radius[j] - ti.sqrt(distance_squared)
        near -= near * do_pass_through_each_other(world_out, r, e, i, j, overlap)
    if near < pairs_out.label[e] & ENGAGED:
        clear_history(pairs_out, e)
    return near


@ti.func
def overlap_length_scale(batch: ti.template(), n):
    """Length that the overlap in lane n is compared with: twice the effective radius [m]."""
    return 2.0 * batch.root_radius[n] * batch.root_radius[n]


@ti.func
def apply_pair_force(world_out: ti.template(), batch: ti.template(), n, r, p, base):
    (grains_out,) = ti.static((world_out.grains,))
    buffer = first_force_place(grains_out, world_out.replicas, r, p)
    size = overlap_length_scale(batch, n)
    report_deep_overlap(world_out.replicas, r, p, batch.owner[n], batch.partner[n], batch.overlap[n], size)
    if batch.acts[n] == 1:
        add_pair_force(world_out, batch, n, buffer)
    else:
        clear_history(world_out.pairs, batch.entry[n])
    if ti.static(world_out.pair_effects.any):
        if do_pair_effects_act(world_out.materials, world_out.pairs, batch.entry[n]):
            force = pair_effect_force(world_out, batch, n, r, base)
            action, reaction = buffer + batch.owner[n], buffer + batch.partner[n]
            grains_out.force[action] = grains_out.force[action] + force
            grains_out.force[reaction] = grains_out.force[reaction] - force
    if ti.static(world_out.sleeps):
        record_sleep_change(world_out.sleep, base + batch.owner[n], base + batch.partner[n])


@ti.func
def add_pair_forces(world_out: ti.template(), r, p):
    grains, pairs, replicas = ti.static((world_out.grains, world_out.pairs, world_out.replicas))
    base = side_start(grains, r, replicas.side[r])
    first, last = replicas.bounds[r, p], replicas.bounds[r, p + 1]
    dt = replicas.time_step[r]
    batch = world_out.batch_type()
    row = replicas.pair_row[r]
    if first < last:
        load_shared_material_row(world_out, batch, row)
        end = pairs.stop[base + last - 1]
        e = first_awake_entry(world_out, base, pairs.start[base + first], end)
        while e < end:
            filled = 0
            while e < end and filled < world_out.lanes:
                filled += load_pair_within_reach(world_out, batch, filled, r, e, base)
                e = first_awake_entry(world_out, base, e + 1, end)
            for n in range(filled):
                load_pair_to_lane(world_out, batch, n, base, row)
            for n in range(filled):
                evaluate_pair_law(world_out.laws, batch, n, dt)
            for n in range(filled):
                apply_pair_force(world_out, batch, n, r, p, base)
