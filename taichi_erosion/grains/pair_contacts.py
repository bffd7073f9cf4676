"""Forces between grains: each partition walks its half list and adds to both partners in its own buffer."""

from taichi_erosion.core.effect import passes, pull_of
from taichi_erosion.core.ti import ti
from taichi_erosion.grains.cells import position_of
from taichi_erosion.grains.contact import contact_force, describe_contact
from taichi_erosion.grains.pairs import ENGAGED, MET, ROW_SHIFT
from taichi_erosion.grains.state import force_block, partition_first, side_block

MULTIPLIER = 0x9E3779B1  # golden ratio of 32 bits, odd (Knuth 1998, Art of Computer Programming 3, sec. 6.4)
STIR, UNIT = 0x85EBCA6B, 2.0**-32  # odd, from the finaliser of MurmurHash3; of a 32-bit number


@ti.func
def report_overlap(replicas_out: ti.template(), r, p, rank, partner, ratio):
    """Keep the first overlap beyond the limit that this partition met."""
    if ratio > replicas_out.overlap_limit[r] and replicas_out.fault_value[r, p] == 0.0:
        replicas_out.fault_value[r, p] = ratio
        replicas_out.fault_grain[r, p] = rank
        replicas_out.fault_partner[r, p] = partner


@ti.func
def forget(entries_out: ti.template(), e):
    """Drop the memory of a contact that has ended."""
    if entries_out.label[e] & ENGAGED == ENGAGED:
        entries_out.label[e] = entries_out.label[e] - ENGAGED
        entries_out.slip[e] = 0.0 * entries_out.slip[e]
        entries_out.tilt[e] = 0.0 * entries_out.tilt[e]


@ti.func
def remember(entries_out: ti.template(), e, slip, tilt):
    """Keep the memory of a contact that acts."""
    entries_out.label[e] = entries_out.label[e] | ENGAGED
    entries_out.slip[e] = slip
    entries_out.tilt[e] = tilt


@ti.func
def pair_touch(world: ti.template(), e, places, normal, elastic):
    """Struct of the contact of a pair; `places` as in `act_on_pair`."""
    grains, pairs = ti.static((world.grains, world.pairs))
    i, j, _, lever = places
    arms = grains.radius[i] * grains.spin[i] + grains.radius[j] * grains.spin[j]
    velocity = grains.velocity[i] - grains.velocity[j] - lever * arms.cross(normal)
    constants = (pairs.root_radius[e], pairs.damping[e], pairs.rolling_damping[e])
    return describe_contact(world.laws, normal, velocity, grains.spin[i] - grains.spin[j], constants, elastic)


@ti.func
def act_on_pair(world_out: ti.template(), r, e, places, normal, elastic):
    """Force [N] and torque [N m] on the owner of an acting contact; the partner gets its share.

    `places` are the owner, the partner, the partner's place in the force buffer, and the lever: the distance
    of the centres over the sum of the radii [1]. Both grains turn about one point of contact, which keeps
    the angular momentum of the pair.
    """
    grains_out, pairs_out, materials = ti.static((world_out.grains, world_out.pairs, world_out.materials))
    i, j, reaction, lever = places
    touch = pair_touch(world_out, e, places, normal, elastic)
    row = pairs_out.label[e] >> ROW_SHIFT
    dt = world_out.replicas.time_step[r]
    force, tangential, moment, slip, tilt = contact_force(
        world_out.laws, materials, row, touch, pairs_out.slip[e], pairs_out.tilt[e], dt
    )
    remember(pairs_out, e, slip, tilt)
    twist = lever * normal.cross(tangential)
    grains_out.force[reaction] = grains_out.force[reaction] - force
    grains_out.torque[reaction] = grains_out.torque[reaction] - moment - grains_out.radius[j] * twist
    return force, moment - grains_out.radius[i] * twist


@ti.func
def touch_stiffness(materials: ti.template(), row, root_radius, overlap):
    """Stiffness of a Hertz contact, 2 E* a [N m-1]."""
    return 2.0 * materials.young[row] * root_radius * ti.sqrt(ti.max(overlap, 0.0))


@ti.func
def hold(bound: ti.template(), entries_out: ti.template(), r, e, pair_out: ti.template()):
    """Attraction by the effects [N]; remembers that the two have met until all have let go."""
    if pair_out.gap <= 0.0:
        entries_out.label[e] = entries_out.label[e] | MET
    pair_out.met = ti.cast((entries_out.label[e] & MET) / MET, float)
    pull = pull_of(bound, r, pair_out)
    if pair_out.gap > 0.0 and pull == 0.0:
        entries_out.label[e] = entries_out.label[e] & ~MET
    return pull


@ti.func
def pull_pair(world_out: ti.template(), r, e, places, normal, gap):
    """Force on the owner by the effects [N]; the partner gets the opposite. `places` as in `act_on_pair`."""
    grains_out, pairs_out = ti.static((world_out.grains, world_out.pairs))
    i, j, reaction, _ = places
    root = pairs_out.root_radius[e]
    pair = world_out.pair_type(
        gap=gap,
        radius_i=grains_out.radius[i],
        radius_j=grains_out.radius[j],
        radius_effective=root * root,
        mass_i=1.0 / grains_out.mass_inverse[i],
        mass_j=1.0 / grains_out.mass_inverse[j],
        closing_speed=(grains_out.velocity[j] - grains_out.velocity[i]).dot(normal),
        stiffness=touch_stiffness(world_out.materials, pairs_out.label[e] >> ROW_SHIFT, root, -gap),
        met=0.0,
    )
    force = -hold(world_out.pair_effects, pairs_out, r, e, pair) * normal
    grains_out.force[reaction] = grains_out.force[reaction] - force
    return force


@ti.func
def chance_of(first, second):
    """Number between 0 and 1 that two grains always have together, in either order."""
    low, high = ti.cast(ti.min(first, second), ti.u32), ti.cast(ti.max(first, second), ti.u32)
    key = (low * ti.u32(MULTIPLIER) + high) * ti.u32(STIR)
    key = (key ^ (key >> ti.u32(15))) * ti.u32(MULTIPLIER)
    return ti.cast(key ^ (key >> ti.u32(16)), float) * UNIT


@ti.func
def passing(world: ti.template(), r, members, e, overlap):
    """Whether two grains, (i, j), pass through each other."""
    grains, replicas = ti.static((world.grains, world.replicas))
    i, j = members
    first, second = position_of(grains, replicas, r, i), position_of(grains, replicas, r, j)
    meeting = world.meeting_type(
        height=ti.cast(ti.min(first[2], second[2]), float),
        depth=overlap / world.pairs.root_radius[e] ** 2,
        chance=chance_of(grains.ident[i], grains.ident[j]),
    )
    return passes(world.meeting_effects, r, meeting)


@ti.func
def overlap_felt(world: ti.template(), r, members, e, overlap):
    """Overlap of two grains [m]; where they pass through each other, a gap out of reach.

    Those that touch go on touching until they part.
    """
    felt = overlap
    if ti.static(world.meeting_effects.any):
        if world.pairs.label[e] & ENGAGED == 0 and overlap > 0.0:
            if passing(world, r, members, e, overlap) == 1:
                felt = -world.replicas.reach[r]
    return felt


@ti.func
def pair_force(world_out: ti.template(), r, p, base, i, e):
    """Force [N] and torque [N m] that entry e exerts on its owner at place i."""
    grains, pairs_out, replicas_out = ti.static((world_out.grains, world_out.pairs, world_out.replicas))
    rank = pairs_out.neighbour[e]
    j = base + rank
    offset = pairs_out.separation[e] + grains.shift[i] - grains.shift[j]
    contact_distance = grains.radius[i] + grains.radius[j]
    reach = contact_distance
    if ti.static(world_out.laws.adhesive or world_out.pair_effects.any):
        reach += replicas_out.reach[r]
    force = 0.0 * offset
    torque = force
    acts = 0
    distance_squared = offset.norm_sqr()
    if distance_squared < reach * reach:
        distance = ti.sqrt(distance_squared)
        root = pairs_out.root_radius[e]
        overlap = overlap_felt(world_out, r, (i, j), e, contact_distance - distance)
        report_overlap(replicas_out, r, p, i - base, rank, overlap / (2.0 * root * root))
        label = pairs_out.label[e]
        row, engaged = label >> ROW_SHIFT, label & ENGAGED
        elastic = world_out.laws.normal_force(world_out.materials, row, overlap, root, engaged)
        acts = elastic[3]
        places = (i, j, force_block(grains, replicas_out, r, p) + rank, distance / contact_distance)
        if acts == 1:
            force, torque = act_on_pair(world_out, r, e, places, offset * (1.0 / distance), elastic)
        if ti.static(world_out.pair_effects.any):
            force += pull_pair(world_out, r, e, places, offset * (1.0 / distance), -overlap)
    if acts == 0:
        forget(pairs_out, e)
    return force, torque


@ti.func
def add_pair_forces(world_out: ti.template(), r, p):
    """Forces of all pairs that one partition owns."""
    grains_out, pairs, replicas = ti.static((world_out.grains, world_out.pairs, world_out.replicas))
    base = side_block(grains_out, r, replicas.side[r])
    buffer = force_block(grains_out, replicas, r, p)
    count = replicas.released[r]
    first = partition_first(count, replicas.partitions[r], p)
    for rank in range(first, partition_first(count, replicas.partitions[r], p + 1)):
        i = base + rank
        force = 0.0 * grains_out.velocity[i]
        torque = force
        for e in range(pairs.start[i], pairs.stop[i]):
            pair, moment = pair_force(world_out, r, p, base, i, e)
            force += pair
            torque += moment
        grains_out.force[buffer + rank] = grains_out.force[buffer + rank] + force
        grains_out.torque[buffer + rank] = grains_out.torque[buffer + rank] + torque
