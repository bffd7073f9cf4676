"""Walls: distance from a point to a plane, a surface of revolution or a triangle, on walls that may move.

The offset of a primitive is the vector from its closest point to the grain's centre. Geometry is evaluated in
f64 at f64 positions: few grains are near a wall, and the overlap is a small difference of large numbers.

A surface of several primitives must act as one: where two primitives share an edge, a grain that touches the
edge may only be pushed once: `wall_contacts.py`, from the closest points found here.
"""

from typing import Any

from taichi_erosion.core.setup import PrimitiveKind
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record
from taichi_erosion.grains.state import arrays

PLANE = int(PrimitiveKind.PLANE)
REVOLVED = int(PrimitiveKind.REVOLVED)
NO_SERVO, FORCE, TORQUE = range(3)  # of Walls.servo
GAIN = 0.1  # of a servo, see `advance_servo` [1]
RAMP = 3e-4  # of its largest speed that a servo without contact gains in a step [1]
LENGTH_LEAST = 1e-30  # keeps directions finite for a centre on the wall itself [m]


@device_record
class Walls:
    """Primitives and surfaces of all replicas; replica r owns rows r * primitives on, and r * surfaces on."""

    primitives: int
    surfaces: int
    kind: Any  # i32 by primitive, PrimitiveKind
    surface: Any  # i32 by primitive
    corner: Any  # f64 vec3 by primitive: plane point, axis point or corner a [m]
    second: Any  # f64 vec3 by primitive: plane normal, axis direction or corner b
    third: Any  # f64 vec3 by primitive: corner c
    profile: Any  # f64 vec4 by primitive: radius and height of both ends of a revolved segment [m]
    ball_centre: Any  # f64 vec3 by primitive, centre of a ball around it [m]
    ball_radius: Any  # f64 by primitive, radius of that ball, infinite for a plane [m]
    material: Any  # i32 by surface
    present: Any  # i32 by surface, 0 once removed
    moving: Any  # i32 by surface
    has_moved: Any  # i32 by surface, 1 once it has been set in motion; till then it stands where it was put
    shift: Any  # f64 vec3 by surface, displacement since the start [m]
    turn: Any  # f64 mat3 by surface, rotation since the start
    velocity: Any  # f64 vec3 by surface [m s-1]
    spin: Any  # f64 vec3 by surface [rad s-1]
    centre: Any  # f64 vec3 by surface, a point of the spin axis at the start [m]
    sweep: Any  # f64 by surface, largest speed at which its shape moves but for a servo [m s-1]
    rows: int  # of all tables of motion of a replica
    table: Any  # f64 by row: time, velocity and spin, seven numbers
    row: Any  # i32 by surface, first row of the table that it follows
    row_count: Any  # i32 by surface, 0 where it follows none
    start_step: Any  # i32 by surface, step at which its motion was set
    servos: int  # partitions whose forces on walls are summed; 0 where no wall has a servo
    servo: Any  # i32 by surface, NO_SERVO, FORCE or TORQUE
    axis: Any  # f64 vec3 by surface, of the servo
    target: Any  # f64 by surface, force [N] or torque [N m] of the wall on the grains
    fastest: Any  # f64 by surface [m s-1] or [rad s-1]
    servo_speed: Any  # f64 by surface, of the last step, likewise
    servo_reach: Any  # f64 by surface, speed of its shape over that of the servo [1] or [m]
    push: Any  # f64 by partition, replica and surface: force or torque of the grains along the axis
    stiffness: Any  # f64 likewise: of the contacts, along the axis [N m-1] or [N m]


def allocate_walls(replicas: int, primitives: int, surfaces: int, rows: int, servos: int) -> Walls:
    """Fields for the walls of all replicas; at least one place of each, since a field cannot be empty."""
    bodies, pieces = replicas * max(surfaces, 1), replicas * max(primitives, 1)
    places, motion = "corner second third ball_centre", "shift velocity spin centre"
    table = arrays(pieces, i32="kind surface", f64="ball_radius", f64x3=places, f64x4="profile")
    table |= arrays(bodies, i32="material present moving has_moved", f64="sweep", f64x3=motion)
    table |= arrays(replicas * max(rows, 1), f64x7="table")
    numbers = "target fastest servo_speed servo_reach"
    table |= arrays(bodies, i32="row row_count start_step servo", f64=numbers, f64x3="axis")
    table |= arrays(max(servos, 1) * bodies, f64="push stiffness")
    turn = ti.Matrix.field(3, 3, ti.f64, shape=bodies)
    return Walls(primitives, surfaces, rows=rows, servos=servos, **table, turn=turn)


@ti.func
def revolved_offset(walls: ti.template(), w, position):
    """From the closest point of a revolved segment to the position [m]."""
    axis = walls.second[w]
    profile = walls.profile[w]
    relative = position - walls.corner[w]
    height = relative.dot(axis)
    radial = relative - height * axis
    radius = radial.norm()
    low_radius, low_height, high_radius, high_height = profile[0], profile[1], profile[2], profile[3]
    along = ti.Vector([high_radius - low_radius, high_height - low_height])
    to_point = ti.Vector([radius - low_radius, height - low_height])
    share = ti.math.clamp(to_point.dot(along) / along.norm_sqr(), 0.0, 1.0)
    away = to_point - share * along
    offset = away[0] * radial / ti.max(radius, LENGTH_LEAST) + away[1] * axis
    if radius == 0.0:  # on the axis every way across it is as near
        x = ti.select(ti.abs(axis[0]) < 0.5, 1.0, 0.0)
        offset += away[0] * axis.cross(ti.Vector([x, 1.0 - x, 0.0])).normalized()
    return offset


@ti.func
def triangle_offset(walls: ti.template(), w, position):
    """From the closest point of a triangle to the position [m].

    Reference: Ericson (2005), Real-Time Collision Detection, section 5.1.5 (regions of a triangle).
    """
    a = walls.corner[w]
    edge_b = walls.second[w] - a
    edge_c = walls.third[w] - a
    normal = edge_b.cross(edge_c)
    relative = position - a
    area = normal.norm_sqr()
    share_b = relative.cross(edge_c).dot(normal) / area
    share_c = edge_b.cross(relative).dot(normal) / area
    offset = relative.dot(normal) / area * normal
    if share_b < 0.0 or share_c < 0.0 or share_b + share_c > 1.0:
        offset = segment_offset(relative, edge_b)
        other = segment_offset(relative, edge_c)
        if other.norm_sqr() < offset.norm_sqr():
            offset = other
        other = segment_offset(relative - edge_b, edge_c - edge_b)
        if other.norm_sqr() < offset.norm_sqr():
            offset = other
    return offset


@ti.func
def segment_offset(relative, edge):
    """From the closest point of the segment 0 .. edge to the point `relative` [m]."""
    share = ti.math.clamp(relative.dot(edge) / edge.norm_sqr(), 0.0, 1.0)
    return relative - share * edge


@ti.func
def wall_offset(walls: ti.template(), w, position):
    """From the closest point of primitive w, at its place at the start, to the position [m]."""
    offset = 0.0 * position
    if walls.kind[w] == PLANE:
        normal = walls.second[w]
        offset = (position - walls.corner[w]).dot(normal) * normal  # behind the plane against the normal
    elif walls.kind[w] == REVOLVED:
        offset = revolved_offset(walls, w, position)
    else:
        offset = triangle_offset(walls, w, position)
    return offset


@ti.func
def wall_distance(walls: ti.template(), w, offset):
    """Distance from primitive w [m], given the offset from its closest point; negative below a plane."""
    distance = offset.norm()
    if walls.kind[w] == PLANE:
        distance = offset.dot(walls.second[w])
    return distance


@ti.func
def into_wall_frame(walls: ti.template(), s, position):
    """Position in the frame of surface s, where the surface is as at the start [m]."""
    local = position
    if walls.has_moved[s] == 1:
        centre = walls.centre[s]
        local = walls.turn[s].transpose() @ (position - centre - walls.shift[s]) + centre
    return local


@ti.func
def out_of_wall_frame(walls: ti.template(), s, direction):
    """Direction in space of a direction in the frame of surface s."""
    turned = direction
    if walls.has_moved[s] == 1:
        turned = walls.turn[s] @ direction
    return turned


@ti.func
def surface_velocity(walls: ti.template(), s, position):
    """Velocity of the material of surface s at a position [m s-1]."""
    velocity = 0.0 * position
    if walls.has_moved[s] == 1:
        velocity = walls.velocity[s] + walls.spin[s].cross(position - walls.centre[s] - walls.shift[s])
    return velocity


@ti.func
def primitive_surface(walls: ti.template(), w):
    """Surface of a primitive, both counted over all replicas."""
    return w // walls.primitives * walls.surfaces + walls.surface[w]


@ti.func
def move_walls(walls_out: ti.template(), replicas_out: ti.template(), r):
    """Advance the moving surfaces of replica r by one time step."""
    dt = ti.cast(replicas_out.time_step[r], ti.f64)
    sweep = ti.cast(0.0, ti.f64)
    for k in range(walls_out.surfaces):
        s = r * walls_out.surfaces + k
        if walls_out.moving[s] == 1:
            if ti.static(walls_out.rows > 0):
                follow_motion_table(walls_out, s, (replicas_out.step[r] - walls_out.start_step[s] + 0.5) * dt)
            if ti.static(walls_out.servos > 0):
                sweep = ti.max(sweep, walls_out.sweep[s] + advance_servo(walls_out, replicas_out, r, s, dt))
            walls_out.shift[s] = walls_out.shift[s] + walls_out.velocity[s] * dt
            walls_out.turn[s] = rodrigues_matrix(walls_out.spin[s] * dt) @ walls_out.turn[s]
            sweep = ti.max(sweep, walls_out.sweep[s])
    replicas_out.wall_travel[r] = replicas_out.wall_travel[r] + ti.cast(sweep * dt, float)


@ti.func
def follow_motion_table(walls_out: ti.template(), s, time):
    """Set velocity and spin of surface s as its table says, linear in time; after its end the last ones.

    What its servo adds to them stays.
    """
    count = walls_out.row_count[s]
    if count > 0:
        low = walls_out.row[s]
        while low < walls_out.row[s] + count - 2 and walls_out.table[low + 1][0] <= time:
            low += 1
        before, after = walls_out.table[low], walls_out.table[ti.min(low, walls_out.row[s] + count - 2) + 1]
        share = ti.math.clamp((time - before[0]) / (after[0] - before[0]), 0.0, 1.0)
        now = before + share * (after - before)
        walls_out.velocity[s] = ti.Vector([now[1], now[2], now[3]])
        walls_out.spin[s] = ti.Vector([now[4], now[5], now[6]])
        servo_part = walls_out.servo_speed[s] * walls_out.axis[s]
        if walls_out.servo[s] == FORCE:
            walls_out.velocity[s] = walls_out.velocity[s] + servo_part
        elif walls_out.servo[s] == TORQUE:
            walls_out.spin[s] = walls_out.spin[s] + servo_part


@ti.func
def advance_servo(walls_out: ti.template(), replicas: ti.template(), r, s, dt):
    """Let the servo of surface s move on; returns the largest speed at which its shape then moves by it.

        v = GAIN (F_target - F) / (K dt),    |v| <= fastest

    F force of the wall on the grains, K sum of the stiffnesses 2 E* a of its contacts (for a torque, times
    the squares of their levers). A gain near dt over the duration of a contact damps best.
    Reference: Itasca, PFC documentation, servomechanism for walls.
    """
    bound = ti.cast(0.0, ti.f64)
    if walls_out.servo[s] != NO_SERVO:
        push, stiffness = bound, bound
        for p in range(replicas.partitions[r]):
            place = servo_sum_place(walls_out, replicas, p, s)
            push += walls_out.push[place]
            stiffness += walls_out.stiffness[place]
            walls_out.push[place], walls_out.stiffness[place] = 0.0, 0.0
        fastest = walls_out.fastest[s]
        target = GAIN * (walls_out.target[s] + push) / ti.max(stiffness * dt, LENGTH_LEAST)
        speed = ti.math.clamp(target, -fastest, fastest)
        if stiffness == 0.0:  # without a contact it gathers speed from rest, so that it does not hammer
            towards = ti.select(speed > 0.0, 1.0, -1.0)
            before = ti.max(towards * walls_out.servo_speed[s], 0.0)
            speed = towards * ti.min(before + RAMP * fastest, ti.abs(speed))
        change = (speed - walls_out.servo_speed[s]) * walls_out.axis[s]
        if walls_out.servo[s] == FORCE:
            walls_out.velocity[s] = walls_out.velocity[s] + change
        else:
            walls_out.spin[s] = walls_out.spin[s] + change
        walls_out.servo_speed[s] = speed
        bound = ti.abs(speed) * walls_out.servo_reach[s]
    return bound


@ti.func
def servo_sum_place(walls: ti.template(), replicas: ti.template(), p, s):
    """Place of partition p and surface s, counted over all replicas, in the sums of servos."""
    return p * replicas.count * walls.surfaces + s


@ti.func
def rodrigues_matrix(vector):
    angle = vector.norm()
    axis = vector / ti.max(angle, LENGTH_LEAST)
    cross = ti.Matrix([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    identity = ti.Matrix.identity(ti.f64, 3)
    return identity + ti.sin(angle) * cross + (1.0 - ti.cos(angle)) * (cross @ cross)
