"""Readback of a running simulation: snapshots, poses of walls, energies."""

import numpy as np

from taichi_erosion.core.setup import Floats, Integers
from taichi_erosion.core.snapshot import Snapshot, Totals, WallPose
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import download
from taichi_erosion.grains.cells import wrapped_position
from taichi_erosion.grains.neighbour_list import ENGAGED, ROW_SHIFT, entry_count
from taichi_erosion.grains.state import side_start
from taichi_erosion.grains.wall_contacts import position_in_wall_frame
from taichi_erosion.grains.walls import wall_distance, wall_offset
from taichi_erosion.simulation.assemble import Simulation
from taichi_erosion.simulation.saved_state import effect_state_variables


def wall_poses(sim: Simulation, replica: int) -> dict[str, WallPose]:
    """Pose of every wall of one replica, by name."""
    walls, names = sim.world.walls, [surface.name for surface in sim.setups[replica].surfaces]
    fields = [walls.present, walls.turn, walls.shift, walls.centre]
    present, turn, shift, centre = download(fields, replica * sim.capacities.surfaces, len(names))
    return {
        # it turns about its centre
        name: WallPose(bool(present[k]), turn[k], centre[k] + shift[k] - turn[k] @ centre[k])
        for k, name in enumerate(names)
    }


# columns of the sums of `sum_over_grain_chunks`
TRANSLATION, ROTATION, POTENTIAL, STORED, SPEED, RELEASED, CONTACTS, OVERLAP = range(8)
CHUNK = 16  # grains that one thread sums where one thread advances one grain
SPHERE_INERTIA = 0.4  # moment of inertia over m R^2 of a solid sphere [1]


@ti.func
def overlap_of_pair_entry(world: ti.template(), base, i, e):
    """Overlap of the pair of entry e [m]."""
    j = base + world.pairs.neighbour[e]
    offset = world.pairs.separation[e] + world.grains.shift[i] - world.grains.shift[j]
    return world.grains.radius[i] + world.grains.radius[j] - offset.norm()


@ti.func
def energy_of_contact_entry(world: ti.template(), entries: ti.template(), e, overlap):
    """Energy in the normal, tangential and rolling springs of entry e of a neighbour or wall list [J]."""
    row, root_radius = entries.label[e] >> ROW_SHIFT, entries.root_radius[e]
    tangential, rolling = entries.tangential_displacement[e], entries.rolling_displacement[e]
    contact_radius = root_radius * ti.sqrt(ti.max(overlap, 0.0))
    energy = world.laws.normal_energy(world.materials, row, overlap, root_radius)
    energy += 4.0 * world.materials.shear[row] * contact_radius * tangential.norm_sqr()
    return energy + world.laws.rolling_energy(world.materials, row, contact_radius, root_radius, rolling)


@ti.func
def wall_overlap(world: ti.template(), i, e):
    """Overlap of a grain with the wall of entry e where both are now [m]."""
    w = world.wall_pairs.wall[e]
    distance = wall_distance(world.walls, w, wall_offset(world.walls, w, position_in_wall_frame(world, i, e)))
    return ti.cast(ti.cast(world.grains.radius[i], ti.f64) - distance, float)


@ti.func
def add_number(numbers_out: ti.template(), row, column, number):
    """Add to a number that no other thread writes."""
    numbers_out[row, column] = numbers_out[row, column] + number


@ti.func
def add_energy_and_speed(world: ti.template(), sums_out: ti.template(), r, row, rank):
    """Kinetic and potential energy [J] and speed [m s-1] of one grain."""
    i, place = side_start(world.grains, r, world.replicas.side[r]) + rank, r * world.grains.capacity + rank
    half = ti.select(world.replicas.step[r] > 0, 0.5 * world.replicas.time_step[r], 0.0)
    mass = 1.0 / world.grains.mass_inverse[i]
    inertia = SPHERE_INERTIA * mass * world.grains.radius[i] ** 2
    velocity = world.grains.velocity[i] + half * world.grains.acceleration[place]
    spin = world.grains.spin[i] + half * world.grains.spin_rate[place]
    position = wrapped_position(world.grains, world.replicas, r, i)
    add_number(sums_out, row, TRANSLATION, 0.5 * mass * velocity.norm_sqr())
    add_number(sums_out, row, ROTATION, 0.5 * inertia * spin.norm_sqr())
    add_number(sums_out, row, POTENTIAL, -mass * position.dot(ti.cast(world.replicas.gravity[r], ti.f64)))
    sums_out[row, SPEED] = ti.max(sums_out[row, SPEED], ti.cast(velocity.norm(), ti.f64))


@ti.func
def add_contact(
    world: ti.template(), entries: ti.template(), sums_out: ti.template(), row, e, overlap, radius
):
    """Stored energy [J] of a contact that acts, and its overlap over a radius [1]."""
    add_number(sums_out, row, STORED, energy_of_contact_entry(world, entries, e, overlap))
    add_number(sums_out, row, CONTACTS, 1.0)
    sums_out[row, OVERLAP] = ti.max(sums_out[row, OVERLAP], ti.cast(overlap / radius, ti.f64))


@ti.func
def add_grain_to_sums(
    world: ti.template(), contacts_out: ti.template(), sums_out: ti.template(), r, row, place, rank, counts
):
    """Motion of one grain, and its contacts with walls and with the grains of its list."""
    pairs, walls = ti.static((world.pairs, world.wall_pairs))
    base = side_start(world.grains, r, world.replicas.side[r])
    i, touching = base + rank, 0
    add_energy_and_speed(world, sums_out, r, place, rank)
    for k in range(entry_count(pairs, i)):
        e = pairs.start[i] + k * pairs.stride
        if pairs.label[e] & ENGAGED == ENGAGED:
            touching += 1
            root, overlap = pairs.root_radius[e], overlap_of_pair_entry(world, base, i, e)
            add_contact(world, pairs, sums_out, place, e, overlap, 2.0 * root * root)
            if counts == 1:  # an atomic sum of whole numbers, in any order
                ti.atomic_add(contacts_out[row, pairs.neighbour[e]], 1)
    for e in range(walls.start[i], walls.stop[i]):
        if walls.label[e] & ENGAGED == ENGAGED:
            touching += 1
            add_contact(world, walls, sums_out, place, e, wall_overlap(world, i, e), world.grains.radius[i])
    if counts == 1:
        ti.atomic_add(contacts_out[row, rank], touching)


@ti.kernel
def sum_over_grain_chunks(
    first: ti.i32,
    last: ti.i32,
    chunk: ti.i32,
    chunks: ti.i32,
    counts: ti.i32,
    world: ti.template(),
    contacts_out: ti.types.ndarray(dtype=ti.i32, ndim=2),
    sums_out: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """Sums over each chunk of grains of replicas first to last; with `counts` the contacts of every grain."""
    for place in range((last - first) * chunks):
        row, begin = place // chunks, place % chunks * chunk
        released = world.replicas.released[first + row]
        for rank in range(begin, ti.min(begin + chunk, released)):
            add_grain_to_sums(world, contacts_out, sums_out, first + row, row, place, rank, counts)
        if begin == 0:
            sums_out[place, RELEASED] = released


def counters_of_replica(sim: Simulation, replica: int) -> tuple[int, int, int, int]:
    """Side, released grains, step and rebuilds of one replica."""
    fields = sim.world.replicas
    values = download([fields.side, fields.released, fields.step, fields.rebuilds], replica, 1)
    side, released, step, rebuilds = (int(v[0]) for v in values)
    return side, released, step, rebuilds


def contact_sums(sim: Simulation, first: int, last: int, counts: bool = False) -> tuple[Integers, Floats]:
    """Contacts by replica and rank where `counts`, and energies [J] and extremes of replicas first to last.

    One thread sums a replica, or a chunk where one thread advances one grain.
    """
    chunk = CHUNK if sim.buffers is not None else sim.capacities.grains
    chunks = -(-sim.capacities.grains // chunk)
    contacts = np.zeros((last - first, sim.capacities.grains) if counts else (1, 1), np.int32)
    sums = np.zeros(((last - first) * chunks, 8))
    sum_over_grain_chunks(first, last, chunk, chunks, int(counts), sim.world, contacts, sums)
    by_replica = sums.reshape(last - first, chunks, 8)
    values = by_replica.sum(axis=1)
    values[:, [SPEED, OVERLAP]] = by_replica[:, :, [SPEED, OVERLAP]].max(axis=1)
    return contacts, values


def grain_positions(sim: Simulation, replica: int, first: int, count: int) -> Floats:
    """Positions [m] of the grains from place `first` on, wrapped into the period."""
    setup = sim.setups[replica]
    origin, shift = download([sim.world.grains.origin, sim.world.grains.shift], first, count)
    place = origin + shift
    for axis, (low, period) in enumerate(zip(setup.domain[0], setup.period, strict=True)):
        if period > 0.0:
            place[:, axis] -= period * np.floor((place[:, axis] - low) / period)
    return place


def snapshot(sim: Simulation, replica: int) -> Snapshot:
    """Released grains of one replica in the order of its GrainTable, velocities as of the positions' time."""
    side, released, step, _ = counters_of_replica(sim, replica)
    grains, rows, setup = sim.world.grains, sim.capacities.grains, sim.setups[replica]
    fields = [grains.velocity, grains.spin, grains.radius, grains.mass_inverse, grains.ident]
    first = (2 * replica + side) * rows
    velocity, spin, radius, inverse, ident = download(fields, first, released)
    rate, spin_rate = download([grains.acceleration, grains.spin_rate], replica * rows, released)
    memory = effect_state_variables(sim)
    states = download([numbers for numbers, _ in memory.values()], first, released) if memory else []
    contacts, _ = contact_sums(sim, replica, replica + 1, counts=True)
    order = np.argsort(ident, kind="stable")
    materials, kind = np.unique(setup.grains.material, return_inverse=True)
    several = len(materials) > 1
    half = 0.5 * setup.time_step * (step > 0)
    return Snapshot(
        time=step * setup.time_step,
        step=step,
        position=grain_positions(sim, replica, first, released)[order],
        velocity=(velocity + half * rate)[order],
        spin=(spin + half * spin_rate)[order],
        radius=radius[order],
        mass=1.0 / inverse[order],
        contacts=contacts[0, order],
        ident=ident[order].astype(np.int32),
        waiting=count_waiting_spheres(sim, replica),
        removed=removed_spheres(sim)[replica],
        effect_state={name: values[order] for name, values in zip(memory, states, strict=True)},
        force=(rate / inverse[:, np.newaxis])[order],
        kind=kind[ident[order].astype(int)].astype(np.int32) if several else None,
        kinds=tuple(setup.materials[place] for place in materials) if several else (),
    )


def energy_totals(sim: Simulation, replica: int) -> Totals:
    """Energies and extremes of one replica, summed over spheres: a clump counts once for every sphere."""
    _, released, step, rebuilds = counters_of_replica(sim, replica)
    _, (sums,) = contact_sums(sim, replica, replica + 1)
    return Totals(
        time=step * sim.setups[replica].time_step,
        step=step,
        kinetic_translation=float(sums[TRANSLATION]),
        kinetic_rotation=float(sums[ROTATION]),
        potential=float(sums[POTENTIAL]),
        elastic=float(sums[STORED]),
        contacts=int(sums[CONTACTS]),
        overlap_largest=float(sums[OVERLAP]),
        speed_largest=float(sums[SPEED]),
        released=released,
        rebuilds=rebuilds,
    )


def removed_spheres(sim: Simulation) -> list[int]:
    """Spheres of every replica that have left its domain and were taken out."""
    return [int(number) for number in download([sim.world.replicas.removed], 0, len(sim.setups))[0]]


def count_waiting_spheres(sim: Simulation, replica: int) -> int:
    """Spheres of one replica that are not released yet."""
    released = counters_of_replica(sim, replica)[1]
    return len(sim.setups[replica].grains.radius) - released - removed_spheres(sim)[replica]


def energy_sums(sim: Simulation) -> Floats:
    """Sums of `sum_over_grain_chunks` up to `RELEASED`, [replicas, 6], for checks of sanity and rest."""
    return contact_sums(sim, 0, len(sim.setups))[1][:, : RELEASED + 1]


def share_of_grains_in_contact(sim: Simulation, replica: int) -> float:
    """Share of the grains that are there with at least one contact [1]; 1 of none."""
    _, released, _, _ = counters_of_replica(sim, replica)
    contacts, _ = contact_sums(sim, replica, replica + 1, counts=True)
    return float(np.mean(contacts[0, :released] > 0)) if released else 1.0
