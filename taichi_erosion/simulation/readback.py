"""Readback of a running simulation: snapshots, poses of walls, energies."""

from dataclasses import dataclass

import numpy as np

from taichi_erosion.core.setup import Floats, Integers
from taichi_erosion.core.snapshot import Snapshot, Totals
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import download
from taichi_erosion.grains.cells import position_of
from taichi_erosion.grains.neighbour_list import ENGAGED, ROW_SHIFT
from taichi_erosion.grains.state import side_block
from taichi_erosion.grains.wall_contacts import position_in_wall_frame
from taichi_erosion.grains.walls import wall_distance, wall_offset
from taichi_erosion.simulation.assemble import Simulation
from taichi_erosion.simulation.saved_state import effect_memory


@dataclass(frozen=True)
class WallPose:
    """A wall as it stands: a point p of it at the start is now at  R p + t."""

    present: bool  # False once removed
    rotation: Floats  # R [3, 3]
    translation: Floats  # t [3] m


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


ELASTIC, CONTACTS, OVERLAP = range(3)  # sums of `read_contacts`
TRANSLATION, ROTATION, POTENTIAL, STORED, SPEED, RELEASED = range(6)  # columns of `sum_replicas`
SPHERE_INERTIA = 0.4  # moment of inertia over m R^2 of a solid sphere [1]


@ti.func
def stored_energy(world: ti.template(), row, overlap, root_radius, tangential, rolling):
    """Energy in the normal, tangential and rolling springs of one contact [J]."""
    contact_radius = root_radius * ti.sqrt(ti.max(overlap, 0.0))
    energy = world.laws.normal_energy(world.materials, row, overlap, root_radius)
    energy += 4.0 * world.materials.shear[row] * contact_radius * tangential.norm_sqr()
    return energy + world.laws.rolling_energy(world.materials, row, contact_radius, root_radius, rolling)


@ti.func
def pair_overlap(world: ti.template(), base, i, e):
    """Overlap of the pair of entry e [m]."""
    j = base + world.pairs.neighbour[e]
    offset = world.pairs.separation[e] + world.grains.shift[i] - world.grains.shift[j]
    return world.grains.radius[i] + world.grains.radius[j] - offset.norm()


@ti.func
def entry_energy(world: ti.template(), entries: ti.template(), e, overlap):
    """Energy stored in the contact of entry e of a neighbour list or wall list [J]."""
    row = entries.label[e] >> ROW_SHIFT
    tangential, rolling = entries.tangential_displacement[e], entries.rolling_displacement[e]
    return stored_energy(world, row, overlap, entries.root_radius[e], tangential, rolling)


@ti.func
def wall_overlap(world: ti.template(), i, e):
    """Overlap of a grain with the wall of entry e where both are now [m]."""
    w = world.wall_pairs.wall[e]
    distance = wall_distance(world.walls, w, wall_offset(world.walls, w, position_in_wall_frame(world, i, e)))
    return ti.cast(ti.cast(world.grains.radius[i], ti.f64) - distance, float)


@ti.func
def add(numbers_out: ti.template(), n, number):
    """Add to a number that no other thread writes."""
    numbers_out[n] = numbers_out[n] + number


@ti.kernel
def read_contacts(
    # parameters
    r: ti.i32,
    # in
    world: ti.template(),
    # out
    contacts_out: ti.types.ndarray(dtype=ti.i32, ndim=1),
    sums_out: ti.types.ndarray(dtype=ti.f64, ndim=1),
):
    """Touching partners of every grain by rank; sums are stored energy [J], contacts, largest overlap [1]."""
    ti.loop_config(serialize=True)
    for rank in range(world.replicas.released[r]):
        base = side_block(world.grains, r, world.replicas.side[r])
        i = base + rank
        for e in range(world.pairs.start[i], world.pairs.stop[i]):
            if world.pairs.label[e] & ENGAGED == ENGAGED:
                root, overlap = world.pairs.root_radius[e], pair_overlap(world, base, i, e)
                add(contacts_out, rank, 1)
                add(contacts_out, world.pairs.neighbour[e], 1)
                add(sums_out, ELASTIC, entry_energy(world, world.pairs, e, overlap))
                add(sums_out, CONTACTS, 1.0)
                share = ti.cast(overlap / (2.0 * root * root), ti.f64)
                sums_out[OVERLAP] = ti.max(sums_out[OVERLAP], share)
        for e in range(world.wall_pairs.start[i], world.wall_pairs.stop[i]):
            if world.wall_pairs.label[e] & ENGAGED == ENGAGED:
                overlap = wall_overlap(world, i, e)
                add(contacts_out, rank, 1)
                add(sums_out, ELASTIC, entry_energy(world, world.wall_pairs, e, overlap))
                add(sums_out, CONTACTS, 1.0)
                share = ti.cast(overlap / world.grains.radius[i], ti.f64)
                sums_out[OVERLAP] = ti.max(sums_out[OVERLAP], share)


@ti.kernel
def read_positions(
    # parameters
    r: ti.i32,
    # in
    world: ti.template(),
    # out
    position_out: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """Positions by rank [m]."""
    for rank in range(world.replicas.released[r]):
        base = side_block(world.grains, r, world.replicas.side[r])
        position = position_of(world.grains, world.replicas, r, base + rank)
        for k in ti.static(range(3)):
            position_out[rank, k] = position[k]


def replica_row(sim: Simulation, replica: int) -> tuple[int, int, int, int]:
    """Side, released grains, step and rebuilds of one replica."""
    fields = sim.world.replicas
    values = download([fields.side, fields.released, fields.step, fields.rebuilds], replica, 1)
    side, released, step, rebuilds = (int(v[0]) for v in values)
    return side, released, step, rebuilds


def contact_sums(sim: Simulation, replica: int, released: int) -> tuple[Integers, Floats]:
    """Contacts by rank, and the sums of `read_contacts`."""
    contacts, sums = np.zeros(max(released, 1), np.int32), np.zeros(3)
    read_contacts(replica, sim.world, contacts, sums)
    return contacts[:released], sums


def snapshot(sim: Simulation, replica: int) -> Snapshot:
    """Released grains of one replica in the order of its GrainTable, velocities as of the positions' time."""
    side, released, step, _ = replica_row(sim, replica)
    grains, rows = sim.world.grains, sim.capacities.grains
    fields = [grains.velocity, grains.spin, grains.radius, grains.mass_inverse, grains.ident]
    first = (2 * replica + side) * rows
    velocity, spin, radius, inverse, ident = download(fields, first, released)
    rate, spin_rate = download([grains.acceleration, grains.spin_rate], replica * rows, released)
    kept = effect_memory(sim)
    states = download([numbers for numbers, _ in kept.values()], first, released) if kept else []
    position = np.zeros((max(released, 1), 3))
    read_positions(replica, sim.world, position)
    contacts, _ = contact_sums(sim, replica, released)
    order = np.argsort(ident, kind="stable")
    half = 0.5 * sim.setups[replica].time_step * (step > 0)
    return Snapshot(
        time=step * sim.setups[replica].time_step,
        step=step,
        position=position[:released][order],
        velocity=(velocity + half * rate)[order],
        spin=(spin + half * spin_rate)[order],
        radius=radius[order],
        mass=1.0 / inverse[order],
        contacts=contacts[order],
        ident=ident[order].astype(np.int32),
        waiting=len(sim.setups[replica].grains.radius) - released,
        effect_state={name: values[order] for name, values in zip(kept, states, strict=True)},
        force=(rate / inverse[:, np.newaxis])[order],
    )


def totals(sim: Simulation, replica: int) -> Totals:
    """Energies and extremes of one replica, summed over spheres: a clump counts once for every sphere."""
    state = snapshot(sim, replica)
    _, released, step, rebuilds = replica_row(sim, replica)
    _, sums = contact_sums(sim, replica, released)
    gravity = download([sim.world.replicas.gravity], replica, 1)[0][0]
    squared = (state.velocity**2).sum(axis=1)
    inertia = SPHERE_INERTIA * state.mass * state.radius**2
    return Totals(
        time=state.time,
        step=step,
        kinetic_translation=float(0.5 * (state.mass * squared).sum()),
        kinetic_rotation=float(0.5 * (inertia * (state.spin**2).sum(axis=1)).sum()),
        potential=float(-(state.mass * (state.position @ gravity)).sum()),
        elastic=float(sums[ELASTIC]),
        contacts=int(sums[CONTACTS]),
        overlap_largest=float(sums[OVERLAP]),
        speed_largest=float(np.sqrt(squared.max(initial=0.0))),
        released=released,
        rebuilds=rebuilds,
    )


@ti.kernel
def sum_replicas(
    # in
    world: ti.template(),
    # out
    sums_out: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """Per replica translational, rotational, potential, stored energy [J], top speed [m s-1], released."""
    for r in range(world.replicas.count):
        base = side_block(world.grains, r, world.replicas.side[r])
        half = ti.select(world.replicas.step[r] > 0, 0.5 * world.replicas.time_step[r], 0.0)
        for rank in range(world.replicas.released[r]):
            i = base + rank
            mass = 1.0 / world.grains.mass_inverse[i]
            inertia = SPHERE_INERTIA * mass * world.grains.radius[i] ** 2
            place = r * world.grains.capacity + rank
            velocity = world.grains.velocity[i] + half * world.grains.acceleration[place]
            spin = world.grains.spin[i] + half * world.grains.spin_rate[place]
            position = position_of(world.grains, world.replicas, r, i)
            lifted = mass * position.dot(ti.cast(world.replicas.gravity[r], ti.f64))
            sums_out[r, TRANSLATION] = sums_out[r, TRANSLATION] + 0.5 * mass * velocity.norm_sqr()
            sums_out[r, ROTATION] = sums_out[r, ROTATION] + 0.5 * inertia * spin.norm_sqr()
            sums_out[r, POTENTIAL] = sums_out[r, POTENTIAL] - lifted
            sums_out[r, SPEED] = ti.max(sums_out[r, SPEED], ti.cast(velocity.norm(), ti.f64))
            for e in range(world.pairs.start[i], world.pairs.stop[i]):
                if world.pairs.label[e] & ENGAGED == ENGAGED:
                    stored = entry_energy(world, world.pairs, e, pair_overlap(world, base, i, e))
                    sums_out[r, STORED] = sums_out[r, STORED] + stored
            for e in range(world.wall_pairs.start[i], world.wall_pairs.stop[i]):
                if world.wall_pairs.label[e] & ENGAGED == ENGAGED:
                    stored = entry_energy(world, world.wall_pairs, e, wall_overlap(world, i, e))
                    sums_out[r, STORED] = sums_out[r, STORED] + stored
        sums_out[r, RELEASED] = world.replicas.released[r]


def energies(sim: Simulation) -> Floats:
    """Sums of `sum_replicas`, [replicas, 6], in one launch, for sanity checks and checks of rest."""
    sums = np.zeros((sim.capacities.replicas, RELEASED + 1))
    sum_replicas(sim.world, sums)
    return sums[: len(sim.setups)]


def share_touching(sim: Simulation, replica: int) -> float:
    """Share of the released grains with at least one contact [1]."""
    _, released, _, _ = replica_row(sim, replica)
    contacts, _ = contact_sums(sim, replica, released)
    return float(np.mean(contacts > 0)) if released else 0.0
