"""Clumps: rigid bodies made of several spheres; contacts act on spheres, motion on bodies.

Bodies are kept in f64: angular momentum and orientation advance by

    L(t + dt/2) = L(t - dt/2) + T dt
    q(t + dt) = q + dt/2 w(q_mid) q,    q_mid = q + dt/4 w(q) q,    w = A(q) I^-1 A(q)^T L,

with T the torque about the centre of mass, w the spin [rad s-1] and A(q) the rotation of the body, and the
positions of the spheres follow from their body in every step, so that a clump never deforms.

Reference: Allen & Tildesley (2017), Computer Simulation of Liquids, 2nd ed., section 3.3.2.
"""

from typing import Any

from taichi_erosion.core.ti import nearest_image, ti
from taichi_erosion.core.transfer import device_record
from taichi_erosion.grains.integrate import kick_duration
from taichi_erosion.grains.state import REBUILD, arrays, first_force_place, side_start

NOWHERE = -1  # of `rank`


@device_record
class Clumps:
    """Bodies of all replicas; replica r owns rows r * capacity on. Spheres go by row of the GrainTable."""

    capacity: int
    first: Any  # i32, first sphere of the body
    number: Any  # i32, spheres of the body
    position: Any  # f64 vec3, centre of mass [m]
    velocity: Any  # f64 vec3 [m s-1]
    momentum: Any  # f64 vec3, angular momentum [kg m2 s-1]
    orientation: Any  # f64 vec4, unit quaternion (w, x, y, z)
    mass_inverse: Any  # f64 [kg-1]
    inertia_inverse: Any  # f64 vec3, principal [kg-1 m-2]
    offset: Any  # f64 vec3 by sphere, in the body's frame [m]
    rank: Any  # i32 by sphere, where it is now; NOWHERE once taken out


def allocate_clumps(replicas: int, bodies: int, spheres: int) -> Clumps:
    """Fields for `bodies` clumps and `spheres` contact spheres a replica."""
    table = arrays(
        replicas * bodies,
        i32="first number",
        f64="mass_inverse",
        f64x3="position velocity momentum inertia_inverse",
        f64x4="orientation",
    )
    return Clumps(bodies, **table, **arrays(replicas * spheres, f64x3="offset", i32="rank"))


@ti.func
def rotation_matrix(q):
    """Rotation of a unit quaternion, body frame to space."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return ti.Matrix(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


@ti.func
def rotate_quaternion(q, spin, time):
    """Unit quaternion after rotation with a spin [rad s-1] for a short time [s]."""
    half = 0.5 * time * spin
    after = q + ti.Vector(
        [
            -half[0] * q[1] - half[1] * q[2] - half[2] * q[3],
            half[0] * q[0] + half[1] * q[3] - half[2] * q[2],
            half[1] * q[0] + half[2] * q[1] - half[0] * q[3],
            half[2] * q[0] + half[0] * q[2] - half[1] * q[1],
        ]
    )
    return after / after.norm()


@ti.func
def clump_spin(clumps: ti.template(), b, frame):
    """Spin of body b [rad s-1]; `frame` is its rotation."""
    return frame @ (clumps.inertia_inverse[b] * (frame.transpose() @ clumps.momentum[b]))


@ti.func
def record_sphere_places(world_out: ti.template(), r, first, last):
    """Record where the sort has put the spheres of ranks first to last, on the valid side."""
    grains, clumps_out = ti.static((world_out.grains, world_out.clumps))
    base = side_start(grains, r, world_out.replicas.side[r])
    for rank in range(first, last):
        clumps_out.rank[r * grains.capacity + grains.ident[base + rank]] = rank


@ti.func
def take_sphere_force(world_out: ti.template(), r, place, arm):
    """Force [N] and torque [N m] on a body from one of its spheres at rank `place`; clears the buffers."""
    grains_out, replicas = ti.static((world_out.grains, world_out.replicas))
    force = 0.0 * arm
    torque = force
    for q in range(replicas.partitions[r]):
        buffer = first_force_place(grains_out, replicas, r, q) + place
        force += ti.cast(grains_out.force[buffer], ti.f64)
        torque += ti.cast(grains_out.torque[buffer], ti.f64)
        grains_out.force[buffer] = 0.0 * grains_out.force[buffer]
        grains_out.torque[buffer] = 0.0 * grains_out.torque[buffer]
    return force, torque + arm.cross(force)


@ti.func
def kick_and_drift_body(world_out: ti.template(), r, b, kick):
    clumps_out, grains = ti.static((world_out.clumps, world_out.grains))
    frame = rotation_matrix(clumps_out.orientation[b])
    force = 0.0 * clumps_out.velocity[b]
    torque = force
    for k in range(clumps_out.number[b]):
        sphere = r * grains.capacity + clumps_out.first[b] + k
        part, turn = take_sphere_force(
            world_out, r, clumps_out.rank[sphere], frame @ clumps_out.offset[sphere]
        )
        force += part
        torque += turn
    dt = ti.cast(world_out.replicas.time_step[r], ti.f64)
    gravity = ti.cast(world_out.replicas.gravity[r], ti.f64)
    clumps_out.velocity[b] = clumps_out.velocity[b] + (force * clumps_out.mass_inverse[b] + gravity) * kick
    clumps_out.momentum[b] = clumps_out.momentum[b] + torque * kick
    clumps_out.position[b] = clumps_out.position[b] + clumps_out.velocity[b] * dt
    q = clumps_out.orientation[b]
    middle = rotation_matrix(rotate_quaternion(q, clump_spin(clumps_out, b, frame), 0.5 * dt))
    clumps_out.orientation[b] = rotate_quaternion(q, clump_spin(clumps_out, b, middle), dt)


@ti.func
def place_spheres(world_out: ti.template(), r, b):
    """Positions and velocities of the spheres of body b; returns REBUILD where one has left its skin."""
    clumps, grains_out = ti.static((world_out.clumps, world_out.grains))
    base = side_start(grains_out, r, world_out.replicas.side[r])
    frame = rotation_matrix(clumps.orientation[b])
    spin = clump_spin(clumps, b, frame)
    period = world_out.replicas.period[r]
    need = 0
    for k in range(clumps.number[b]):
        sphere = r * grains_out.capacity + clumps.first[b] + k
        i = base + clumps.rank[sphere]
        arm = frame @ clumps.offset[sphere]
        away = clumps.position[b] + arm - grains_out.origin[i]
        grains_out.shift[i] = ti.cast(nearest_image(away, period), float)
        grains_out.velocity[i] = ti.cast(clumps.velocity[b] + spin.cross(arm), float)
        grains_out.spin[i] = ti.cast(spin, float)
        if grains_out.shift[i].norm_sqr() <= grains_out.skin_squared[i]:
            need = need | 0
        else:
            need = REBUILD  # also where the shift is not a number
    return need


@ti.func
def released_body_count(world: ti.template(), r):
    released, bodies = world.replicas.released[r] + world.replicas.removed[r], 0
    if released > 0:
        bodies = world.source.body[r * world.grains.capacity + released - 1] + 1
    return bodies


@ti.func
def advance_clump(world_out: ti.template(), r, k, step):
    """Advance body k of replica r; returns REBUILD where one of its spheres has left its skin."""
    b, need = r * world_out.clumps.capacity + k, 0
    if world_out.clumps.rank[r * world_out.grains.capacity + world_out.clumps.first[b]] != NOWHERE:
        kick_and_drift_body(world_out, r, b, ti.cast(kick_duration(world_out.replicas, r, step), ti.f64))
        need = place_spheres(world_out, r, b)
    return need


@ti.func
def advance_clumps(world_out: ti.template(), r, p, step):
    """Advance the released bodies of partition p; returns REBUILD where a rebuild is due."""
    partitions, bodies = world_out.replicas.partitions[r], released_body_count(world_out, r)
    need = 0
    for k in range(bodies * p // partitions, bodies * (p + 1) // partitions):
        need = need | advance_clump(world_out, r, k, step)
    return need
