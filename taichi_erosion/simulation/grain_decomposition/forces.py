"""Forces of the grain decomposition: a pair evaluates its contact law, a grain sums its forces and moves."""

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.integrate import advance_awake, kick_time
from taichi_erosion.grains.neighbour_list import ROW_SHIFT, end_contact, entry_block
from taichi_erosion.grains.pair_contacts import (
    detect_pair,
    effects_act,
    evaluate_pair,
    is_too_deep,
    load_pair,
    pair_effect_force,
    pair_size,
    pair_torques,
)
from taichi_erosion.grains.simd_batch import lane, load_entry, load_materials, store_contact
from taichi_erosion.grains.sleep import next_awake, note_wake
from taichi_erosion.grains.state import force_block, side_block
from taichi_erosion.grains.wall_contacts import add_wall_force, detect_wall, evaluate_wall, next_wall_entry


@ti.func
def evaluate_entry(world_out: ti.template(), buffers_out: ti.template(), r, k):
    """Force of the pair of entry k of replica r, kept for both grains; its history advances."""
    base = side_block(world_out.grains, r, world_out.replicas.side[r])
    e = entry_block(world_out.pairs, r, world_out.replicas.side[r]) + k
    place = r * world_out.pairs.capacity + k
    buffers_out.level[place] = 0.0
    batch = world_out.batch_type()
    near = 0
    if next_awake(world_out, base, e, e + 1) == e:
        near = detect_pair(world_out, batch, 0, r, e, base)
    if near == 1:
        load_pair(world_out, batch, 0, base, -1)
        evaluate_pair(world_out.laws, batch, 0, world_out.replicas.time_step[r])
        keep_pair(world_out, buffers_out, batch, r, base, place)
        if ti.static(world_out.sleeps):
            note_wake(world_out.sleep, base + batch.owner[0], base + batch.partner[0])


@ti.func
def keep_pair(world_out: ti.template(), buffers_out: ti.template(), batch: ti.template(), r, base, place):
    """Keep force and torques of an evaluated pair, and a note where its overlap is too large."""
    e, level = batch.entry[0], 0.0
    force = 0.0 * lane(batch.force, 0)
    torque, back = force, force
    if batch.acts[0] == 1:
        store_contact(world_out.pairs, batch, 0)
        force = lane(batch.force, 0)
        torque, back = pair_torques(batch, 0)
        level = 1.0
    else:
        end_contact(world_out.pairs, e)
    if ti.static(world_out.pair_effects.any):
        if effects_act(world_out.materials, world_out.pairs, e):
            force += pair_effect_force(world_out, batch, 0, r, base)
            level = 1.0
    size = pair_size(batch, 0)
    if is_too_deep(world_out.replicas, r, batch.overlap[0], size):
        level = 1.0 + batch.overlap[0] / size
        ti.atomic_min(buffers_out.faulty[r], place - r * world_out.pairs.capacity)
    buffers_out.force[place] = force
    buffers_out.torque[place] = torque
    buffers_out.back[place] = back
    buffers_out.level[place] = level


@ti.func
def sum_pairs(world_out: ti.template(), buffers: ti.template(), r, rank):
    """Add the forces of all pairs of a grain to its buffer: first its own entries, then its reverse list."""
    grains_out, pairs, replicas = ti.static((world_out.grains, world_out.pairs, world_out.replicas))
    i = side_block(grains_out, r, replicas.side[r]) + rank
    buffer, row = force_block(grains_out, replicas, r, 0) + rank, r * grains_out.capacity + rank
    first, entries = entry_block(pairs, r, replicas.side[r]), r * pairs.capacity
    force, torque = grains_out.force[buffer], grains_out.torque[buffer]
    for e in range(pairs.start[i], pairs.stop[i]):
        place = entries + e - first
        if buffers.level[place] > 0.0:
            force += buffers.force[place]
            torque += buffers.torque[place]
    for n in range(buffers.start[row], buffers.stop[row]):
        place = entries + buffers.partner_entry[n]
        if buffers.level[place] > 0.0:
            force -= buffers.force[place]
            torque -= buffers.back[place]
    grains_out.force[buffer] = force
    grains_out.torque[buffer] = torque


@ti.func
def add_walls(world_out: ti.template(), buffers_out: ti.template(), r, rank):
    """Add the forces of all walls on a grain to its buffer."""
    entries, replicas = ti.static((world_out.wall_pairs, world_out.replicas))
    base = side_block(world_out.grains, r, replicas.side[r])
    buffer = force_block(world_out.grains, replicas, r, 0)
    e, end = entries.start[base + rank], entries.stop[base + rank]
    deep = 0
    while e < end:
        e = next_wall_entry(world_out, base, e, end)
        if e < end:
            batch = world_out.batch_type()
            if detect_wall(world_out, batch, 0, r, base, e) == 1:
                load_entry(world_out, entries, batch, 0)
                load_materials(world_out, batch, 0, entries.label[e] >> ROW_SHIFT)
                evaluate_wall(world_out.laws, batch, 0, replicas.time_step[r])
                deep = deep | note_deep_wall(world_out, buffers_out, batch, r, rank)
                add_wall_force(world_out, batch, 0, r, base, buffer)
            e += 1
    if deep == 1:
        # it comes behind all pairs
        ti.atomic_min(buffers_out.faulty[r], world_out.pairs.capacity + rank)


@ti.func
def note_deep_wall(world: ti.template(), buffers_out: ti.template(), batch: ti.template(), r, rank):
    """Note the wall that a grain overlaps too far with; returns 1 where it does, else 0."""
    overlap, radius, deep = batch.overlap[0], batch.radius_i[0], 0
    if is_too_deep(world.replicas, r, overlap, radius):
        place = r * world.grains.capacity + rank
        buffers_out.wall_overlap[place] = overlap / radius
        buffers_out.wall[place] = batch.partner[0]
        deep = 1
    return deep


@ti.func
def move(world_out: ti.template(), r, rank):
    """Motion of one grain that is awake; one that has left its skin asks for a rebuild."""
    grains_out, replicas_out = ti.static((world_out.grains, world_out.replicas))
    i = side_block(grains_out, r, replicas_out.side[r]) + rank
    buffer = force_block(grains_out, replicas_out, r, 0) + rank
    kick = kick_time(replicas_out, r, replicas_out.step[r])
    place = ti.select(replicas_out.steps_left[r] == 1, r * grains_out.capacity + rank, -1)
    need = advance_awake(world_out, r, i, buffer, kick, place)
    if need != 0:
        ti.atomic_max(replicas_out.need[r, 0], need)
