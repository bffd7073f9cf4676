"""Time integration of grains: leapfrog, the velocity half a step before the position.

    v(t + dt/2) = v(t - dt/2) + a(t) dt,    x(t + dt) = x(t) + v(t + dt/2) dt

The first kick of a replica is dt/2, which makes the positions those of the velocity-Verlet scheme.

Reference: Allen & Tildesley (2017), Computer Simulation of Liquids, 2nd ed., section 3.2.
"""

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.frozen_drag import velocity_after_drag
from taichi_erosion.grains.sleep import hold_sleeping_grain
from taichi_erosion.grains.state import REBUILD, STOP, first_force_place, side_start

SPHERE = 2.5  # m R^2 over the moment of inertia of a solid sphere [1]


@ti.func
def add_partition_buffers(world_out: ti.template(), r, p):
    """Add the forces in the buffers of other partitions to those of partition p, in a fixed order."""
    grains_out, replicas = ti.static((world_out.grains, world_out.replicas))
    block = first_force_place(grains_out, replicas, r, p)
    first, last = replicas.bounds[r, p], replicas.bounds[r, p + 1]
    for q in range(replicas.partitions[r]):
        if q != p:
            other = first_force_place(grains_out, replicas, r, q)
            low = ti.select(p < q, replicas.before_low[r, q], replicas.after_low[r, q])
            high = ti.select(p < q, replicas.before_high[r, q], replicas.after_high[r, q])
            for rank in range(ti.max(first, low), ti.min(last, high)):
                i, j = block + rank, other + rank
                grains_out.force[i] = grains_out.force[i] + grains_out.force[j]
                grains_out.torque[i] = grains_out.torque[i] + grains_out.torque[j]
                grains_out.force[j] = 0.0 * grains_out.force[i]
                grains_out.torque[j] = 0.0 * grains_out.torque[i]


@ti.func
def kick_duration(replicas: ti.template(), r, step):
    """Time over which this step's force acts on the velocity [s]."""
    return replicas.time_step[r] * ti.select(step == 0, 0.5, 1.0)


@ti.func
def record_rates(grains_out: ti.template(), place, acceleration, spin_rate):
    """Record the rates of the last step of a launch; at place -1 nothing."""
    if place >= 0:
        grains_out.acceleration[place] = acceleration
        grains_out.spin_rate[place] = spin_rate


@ti.func
def kick_and_drift_grain(world_out: ti.template(), r, i, buffer, kick, place):
    """Kick and drift the grain at place i, and clear its buffer; returns REBUILD where it left its skin."""
    grains_out, frozen_out = ti.static((world_out.grains, world_out.frozen_drag))
    inverse, radius = grains_out.mass_inverse[i], grains_out.radius[i]
    gravity = world_out.replicas.gravity[r]
    acceleration = grains_out.force[buffer] * inverse + gravity
    spin_rate = grains_out.torque[buffer] * (SPHERE * inverse / (radius * radius))
    grains_out.force[buffer] = 0.0 * gravity
    grains_out.torque[buffer] = 0.0 * gravity
    if ti.static(world_out.has_external_forces):
        acceleration += frozen_out.steady_acceleration[i]
        spin_rate += frozen_out.steady_spin_rate[i]
    velocity = grains_out.velocity[i] + acceleration * kick
    if ti.static(world_out.has_external_forces):
        velocity = velocity_after_drag(frozen_out, i, velocity, kick)
        acceleration = (velocity - grains_out.velocity[i]) / kick
    shift = grains_out.shift[i] + velocity * world_out.replicas.time_step[r]
    grains_out.velocity[i] = velocity
    grains_out.spin[i] = grains_out.spin[i] + spin_rate * kick
    grains_out.shift[i] = shift
    record_rates(grains_out, place, acceleration, spin_rate)
    need = REBUILD  # also where the shift is not a number
    if shift.norm_sqr() <= grains_out.skin_squared[i]:
        need = 0
    return need


@ti.func
def advance_grains(world_out: ti.template(), r, p, step, is_last):
    """Advance the awake grains of one partition; returns REBUILD where a rebuild is due."""
    grains, replicas = ti.static((world_out.grains, world_out.replicas))
    base = side_start(grains, r, replicas.side[r])
    buffer = first_force_place(grains, replicas, r, p)
    kick = kick_duration(replicas, r, step)
    need = 0
    for rank in range(replicas.bounds[r, p], replicas.bounds[r, p + 1]):
        place = ti.select(is_last, r * grains.capacity + rank, -1)
        need = need | advance_if_awake(world_out, r, base + rank, buffer + rank, kick, place)
    return need


@ti.func
def advance_if_awake(world_out: ti.template(), r, i, buffer, kick, place):
    """Advance the grain at place i unless it sleeps; returns REBUILD where it has left its skin."""
    moves, need = True, 0
    if ti.static(world_out.sleeps):
        moves = not hold_sleeping_grain(world_out, r, i, buffer, kick)
        if not moves:
            still = 0.0 * world_out.replicas.gravity[r]
            record_rates(world_out.grains, place, still, still)
    if moves:
        need = kick_and_drift_grain(world_out, r, i, buffer, kick, place)
    return need


@ti.func
def publish_next_action(replicas_out: ti.template(), r, p, need):
    """Publish what partition p needs before the next step: nothing, REBUILD or STOP."""
    if replicas_out.fault_value[r, p] > 0.0:
        need = STOP
    replicas_out.need[r, p] = need
