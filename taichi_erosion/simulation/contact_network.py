"""Contact network of a replica: which bodies act on each other, where, and with what force.

The laws are evaluated at the present positions, as the next step will do, and nothing of the state changes:
the sum over the contacts of a grain, with its weight, is the force that the next step finds on it.
"""

import numpy as np

from taichi_erosion.core.snapshot import ContactNetwork
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import download
from taichi_erosion.grains.neighbour_list import ROW_SHIFT, entry_count
from taichi_erosion.grains.pair_contacts import (
    do_pair_effects_act,
    evaluate_pair_law,
    load_pair_to_lane,
    load_pair_within_reach,
    pair_effect_force,
)
from taichi_erosion.grains.simd_batch import lane, load_entry_to_lane, load_materials_row
from taichi_erosion.grains.state import side_start
from taichi_erosion.grains.wall_contacts import (
    detect_wall,
    evaluate_wall,
    locate_wall_contacts,
    transfer_wall_history,
    wall_effect_force,
)
from taichi_erosion.simulation.assemble import Simulation
from taichi_erosion.simulation.readback import counters_of_replica, grain_positions

COLUMNS = 8  # of a row: partner, normal, distance, force


@ti.func
def restore_contact_history(entries_out: ti.template(), e, label, tangential, rolling):
    entries_out.label[e] = label
    entries_out.tangential_displacement[e] = tangential
    entries_out.rolling_displacement[e] = rolling


@ti.func
def force_of_pair_entry(world_out: ti.template(), batch_out: ti.template(), r, base, e):
    """Force of entry e of the neighbour list on its owner [N], zero where nothing acts."""
    (pairs,) = ti.static((world_out.pairs,))
    label = pairs.label[e]
    tangential = pairs.tangential_displacement[e]
    rolling = pairs.rolling_displacement[e]
    force = ti.Vector.zero(float, 3)
    if load_pair_within_reach(world_out, batch_out, 0, r, e, base) == 1:
        load_pair_to_lane(world_out, batch_out, 0, base, -1)
        evaluate_pair_law(world_out.laws, batch_out, 0, world_out.replicas.time_step[r])
        if batch_out.acts[0] == 1:
            force = lane(batch_out.force, 0)
        if ti.static(world_out.pair_effects.any):
            if do_pair_effects_act(world_out.materials, pairs, e):
                force += pair_effect_force(world_out, batch_out, 0, r, base)
    restore_contact_history(pairs, e, label, tangential, rolling)
    return force


@ti.func
def force_of_wall_entry(world_out: ti.template(), batch_out: ti.template(), r, base, e):
    """Force of entry e of the wall list on its grain [N], zero where nothing acts."""
    (entries,) = ti.static((world_out.wall_pairs,))
    label, tangential = entries.label[e], entries.tangential_displacement[e]
    rolling, force = entries.rolling_displacement[e], ti.Vector.zero(float, 3)
    if detect_wall(world_out, batch_out, 0, r, base, e) == 1:
        load_entry_to_lane(world_out, entries, batch_out, 0)
        load_materials_row(world_out, batch_out, 0, label >> ROW_SHIFT)
        evaluate_wall(world_out.laws, batch_out, 0, world_out.replicas.time_step[r])
        if batch_out.acts[0] == 1:
            force = lane(batch_out.force, 0)
        if ti.static(world_out.pair_effects.any):
            if do_pair_effects_act(world_out.materials, entries, e):
                force += wall_effect_force(world_out, r, batch_out, 0, base + batch_out.owner[0])
    restore_contact_history(entries, e, label, tangential, rolling)
    return force


@ti.func
def write_contact_row(rows_out: ti.template(), place, partner, normal, distance, force):
    """Write one contact where there is room; returns 1 for a force that is not zero, else 0."""
    acts = ti.cast(force.norm_sqr() > 0.0, ti.i32)
    if acts == 1 and place < rows_out.shape[0]:
        rows_out[place, 0] = partner
        rows_out[place, 4] = distance
        for k in ti.static(range(3)):
            rows_out[place, 1 + k] = normal[k]
            rows_out[place, 5 + k] = force[k]
    return acts


@ti.func
def list_grain_contacts(world_out: ti.template(), rows_out: ti.template(), r, rank, first):
    """Write the contacts of one grain from row `first` on; returns their number."""
    pairs, walls = ti.static((world_out.pairs, world_out.wall_pairs))
    base = side_start(world_out.grains, r, world_out.replicas.side[r])
    i, batch, n = base + rank, world_out.batch_type(), 0
    for k in range(entry_count(pairs, i)):
        force = force_of_pair_entry(world_out, batch, r, base, pairs.start[i] + k * pairs.stride)
        distance = lane(batch.offset, 0).norm()
        normal = lane(batch.offset, 0) / distance
        n += write_contact_row(rows_out, first + n, batch.partner[0], normal, distance, force)
    locate_wall_contacts(world_out, i)
    transfer_wall_history(world_out, i)
    for e in range(walls.start[i], walls.stop[i]):
        force = force_of_wall_entry(world_out, batch, r, base, e)
        distance = world_out.grains.radius[i] - batch.overlap[0]
        n += write_contact_row(rows_out, first + n, batch.partner[0], lane(batch.offset, 0), distance, force)
    return n


@ti.kernel
def list_contacts(
    r: ti.i32,
    released: ti.i32,
    first: ti.types.ndarray(dtype=ti.i32, ndim=1),
    number_out: ti.types.ndarray(dtype=ti.i32, ndim=1),
    rows_out: ti.types.ndarray(dtype=ti.f64, ndim=2),
    world_out: ti.template(),
):
    """Number of the contacts of every grain of replica r, and their rows where there is room.

    Labels and displacements get back what they held, the rest is what the next step would write.
    """
    for rank in range(released):
        number_out[rank] = list_grain_contacts(world_out, rows_out, r, rank, first[rank])


def contact_network(sim: Simulation, replica: int) -> ContactNetwork:
    """All contacts of one replica in order of their grains; the lower row of the GrainTable comes first."""
    side, released, step, _ = counters_of_replica(sim, replica)
    setup, place = sim.setups[replica], (2 * replica + side) * sim.capacities.grains
    number = np.zeros(max(released, 1), np.int32)
    list_contacts(replica, released, np.zeros_like(number), number, np.zeros((1, COLUMNS)), sim.world)
    rows = np.zeros((max(int(number.sum()), 1), COLUMNS))
    list_contacts(replica, released, np.cumsum(number, dtype=np.int32) - number, number, rows, sim.world)
    rows = rows[: number.sum()]
    ident, radius = download([sim.world.grains.ident, sim.world.grains.radius], place, released)
    position, ident = grain_positions(sim, replica, place, released), ident.astype(np.int32)
    one, other = np.repeat(np.arange(released), number[:released]), rows[:, 0].astype(np.int32)
    normal, distance, force = rows[:, 1:4], rows[:, 4], rows[:, 5:8]
    pairs, partner = other >= 0, np.maximum(other, 0)
    swap = pairs & (ident[one] > ident[partner])
    one, partner = np.where(swap, partner, one), np.where(swap, one, partner)
    sign = np.where(swap, -1.0, 1.0)[:, None]
    lever = distance * radius[one] / (radius[one] + np.where(pairs, radius[partner], 0.0))
    wall = np.where(pairs, 0, -1 - other - replica * sim.world.walls.primitives)
    second = np.where(pairs, ident[partner], -1 - setup.primitives.surface[wall])
    order = np.lexsort((second, ident[one]))
    return ContactNetwork(
        time=step * setup.time_step,
        first=ident[one][order],
        second=second[order].astype(np.int32),
        centre=position[one][order],
        point=(position[one] - lever[:, None] * sign * normal)[order],
        branch=(distance[:, None] * sign * normal)[order],
        normal=(sign * normal)[order],
        force=(sign * force)[order],
        walls=tuple(surface.name for surface in setup.surfaces),
    )
