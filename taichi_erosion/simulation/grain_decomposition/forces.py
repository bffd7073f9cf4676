"""Forces of the grain decomposition: pairs and walls are evaluated, a grain sums its forces and moves."""

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.clumps import advance_clump, released_body_count
from taichi_erosion.grains.integrate import advance_if_awake, kick_duration
from taichi_erosion.grains.neighbour_list import ROW_SHIFT, clear_history, entry_count
from taichi_erosion.grains.pair_contacts import (
    do_pair_effects_act,
    evaluate_pair_law,
    is_overlap_too_deep,
    load_pair_to_lane,
    load_pair_within_reach,
    overlap_length_scale,
    pair_effect_force,
    pair_torques,
)
from taichi_erosion.grains.simd_batch import lane, load_entry_to_lane, load_materials_row, store_history
from taichi_erosion.grains.sleep import first_awake_entry, record_sleep_change
from taichi_erosion.grains.state import first_force_place, side_start
from taichi_erosion.grains.wall_contacts import add_wall_force, detect_wall, evaluate_wall, next_wall_entry

WALLS = 1  # buffer of the forces of walls; that of pairs is the first


@ti.func
def evaluate_pair_at(world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, k):
    """Force of the pair at place k of the entries of replica r, if there is one."""
    (pairs,) = ti.static((world_out.pairs,))
    if k < buffers_out.listed[r] and k % pairs.stride < world_out.replicas.released[r]:
        side = world_out.replicas.side[r]
        e = side_start(pairs, r, side) + k
        if e < pairs.stop[side_start(world_out.grains, r, side) + k % pairs.stride]:
            evaluate_pair_entry(world_out, buffers_out, r, k, e)


@ti.func
def evaluate_pair_entry(world_out: ti.template(), buffers_out: ti.template(), r, k, e):
    """Force of the pair of entry e, at place k of replica r, kept for both; its history advances."""
    base = side_start(world_out.grains, r, world_out.replicas.side[r])
    batch, place = world_out.batch_type(), r * world_out.pairs.capacity + k
    near, acts = 0, 0
    if first_awake_entry(world_out, base, e, e + 1) == e:
        near = load_pair_within_reach(world_out, batch, 0, r, e, base)
    if near == 1:
        load_pair_to_lane(world_out, batch, 0, base, -1)
        evaluate_pair_law(world_out.laws, batch, 0, world_out.replicas.time_step[r])
        acts = store_pair_force(world_out, buffers_out, batch, r, base, place)
        size, rank = overlap_length_scale(batch, 0), batch.owner[0]
        if is_overlap_too_deep(world_out.replicas, r, batch.overlap[0], size):
            note_overlap(world_out, buffers_out, r, rank, batch.partner[0], batch.overlap[0] / size, rank)
        if ti.static(world_out.sleeps):
            record_sleep_change(world_out.sleep, base + batch.owner[0], base + batch.partner[0])
    if acts == 0 and buffers_out.acts[place] == 1:
        clear_pair_force(buffers_out, place)


@ti.func
def store_pair_force(
    world_out: ti.template(), buffers_out: ti.template(), batch: ti.template(), r, base, place
):
    """Keep force and torques of an evaluated pair; returns 1 where there are any, else 0."""
    e, acts = batch.entry[0], batch.acts[0]
    force = 0.0 * lane(batch.force, 0)
    torque, back = force, force
    if batch.acts[0] == 1:
        store_history(world_out.pairs, batch, 0)
        force = lane(batch.force, 0)
        torque, back = pair_torques(batch, 0)
    else:
        clear_history(world_out.pairs, e)
    if ti.static(world_out.pair_effects.any):
        if do_pair_effects_act(world_out.materials, world_out.pairs, e):
            force += pair_effect_force(world_out, batch, 0, r, base)
            acts = 1
    if acts == 1:
        buffers_out.force[place] = force
        buffers_out.torque[place] = torque
        buffers_out.back[place] = back
        buffers_out.acts[place] = 1
    return acts


@ti.func
def clear_pair_force(buffers_out: ti.template(), place):
    """Zero force and torques of a pair: sums are taken over all pairs, and wait for no other number."""
    for sum_out in ti.static((buffers_out.force, buffers_out.torque, buffers_out.back)):
        sum_out[place] = ti.Vector.zero(float, 3)
    buffers_out.acts[place] = 0


@ti.func
def sum_pair_forces(world_out: ti.template(), buffers: ti.template(), r, rank):
    """Sum the forces of all pairs of a grain: first its own entries, then its reverse list."""
    grains_out, pairs, replicas = ti.static((world_out.grains, world_out.pairs, world_out.replicas))
    i, row = side_start(grains_out, r, replicas.side[r]) + rank, r * grains_out.capacity + rank
    entries = r * pairs.capacity
    force, torque = ti.Vector.zero(float, 3), ti.Vector.zero(float, 3)
    for k in range(entry_count(pairs, i)):
        place = entries + rank + k * pairs.stride
        force += buffers.force[place]
        torque += buffers.torque[place]
    for k in range(buffers.partners[row]):
        place = entries + buffers.partner_entry[entries + rank + k * pairs.stride]
        force -= buffers.force[place]
        torque -= buffers.back[place]
    buffer = first_force_place(grains_out, replicas, r, 0) + rank
    grains_out.force[buffer] = force
    grains_out.torque[buffer] = torque


@ti.func
def note_overlap(world: ti.template(), buffers_out: ti.template(), r, rank, partner, overlap, order):
    """Note too large an overlap of a grain, unless one of a smaller order is noted."""
    if ti.atomic_min(buffers_out.faulty[r], order) > order:
        place = r * world.grains.capacity + rank
        buffers_out.overlap[place] = overlap
        buffers_out.partner[place] = partner


@ti.func
def evaluate_wall_forces(world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, n):
    """Forces of the walls on one of the grains near them."""
    if n < buffers_out.walled[r]:
        sum_wall_forces(world_out, buffers_out, r, buffers_out.walled_rank[r * world_out.grains.capacity + n])


@ti.func
def sum_wall_forces(world_out: ti.template(), buffers_out: ti.template(), r, rank):
    """Forces of all walls on a grain, in a buffer of their own."""
    entries, replicas = ti.static((world_out.wall_pairs, world_out.replicas))
    base = side_start(world_out.grains, r, replicas.side[r])
    buffer = first_force_place(world_out.grains, replicas, r, WALLS)
    e, end = entries.start[base + rank], entries.stop[base + rank]
    while e < end:
        e = next_wall_entry(world_out, base, e, end)
        if e < end:
            batch = world_out.batch_type()
            if detect_wall(world_out, batch, 0, r, base, e) == 1:
                load_entry_to_lane(world_out, entries, batch, 0)
                load_materials_row(world_out, batch, 0, entries.label[e] >> ROW_SHIFT)
                evaluate_wall(world_out.laws, batch, 0, replicas.time_step[r])
                add_wall_force(world_out, batch, 0, r, base, buffer)
                overlap, radius = batch.overlap[0], batch.radius_i[0]
                if is_overlap_too_deep(replicas, r, overlap, radius):
                    order = world_out.grains.capacity + rank  # behind all pairs
                    note_overlap(world_out, buffers_out, r, rank, batch.partner[0], overlap / radius, order)
            e += 1


@ti.func
def sum_all_forces(world_out: ti.template(), coupling: ti.template(), buffers: ti.template(), r, rank):
    """Sum of the forces of pairs and walls on one grain."""
    grains_out, replicas, entries = ti.static((world_out.grains, world_out.replicas, world_out.wall_pairs))
    if rank < replicas.released[r]:
        sum_pair_forces(world_out, buffers, r, rank)
        i = side_start(grains_out, r, replicas.side[r]) + rank
        if entries.start[i] < entries.stop[i]:
            buffer = first_force_place(grains_out, replicas, r, 0) + rank
            walls = first_force_place(grains_out, replicas, r, WALLS) + rank
            for sum_out in ti.static((grains_out.force, grains_out.torque)):
                sum_out[buffer] = sum_out[buffer] + sum_out[walls]
                sum_out[walls] = 0.0 * sum_out[walls]


@ti.func
def move_grain(world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, rank):
    """Motion of one grain under the sum of its forces; one that has left its skin asks for new lists."""
    grains_out, replicas = ti.static((world_out.grains, world_out.replicas))
    sum_all_forces(world_out, coupling, buffers_out, r, rank)
    if rank < replicas.released[r]:
        i = side_start(grains_out, r, replicas.side[r]) + rank
        buffer = first_force_place(grains_out, replicas, r, 0) + rank
        kick = kick_duration(replicas, r, buffers_out.step[r])
        place = ti.select(buffers_out.last[r] == 1, r * grains_out.capacity + rank, -1)
        request_new_lists(world_out, buffers_out, r, advance_if_awake(world_out, r, i, buffer, kick, place))


@ti.func
def move_body(world_out: ti.template(), coupling: ti.template(), buffers_out: ti.template(), r, k):
    """Motion of one clump: the forces on its spheres are summed in their order."""
    if k < released_body_count(world_out, r):
        request_new_lists(world_out, buffers_out, r, advance_clump(world_out, r, k, buffers_out.step[r]))


@ti.func
def request_new_lists(world_out: ti.template(), buffers_out: ti.template(), r, need):
    """Let replica r wait for new lists where a grain has left its skin."""
    if need != 0:
        ti.atomic_max(world_out.replicas.need[r, 0], need)
        buffers_out.pending[0] = 1
