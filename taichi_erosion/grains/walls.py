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
    moved: Any  # i32 by surface, 1 once it has been set in motion; till then it stands where it was put
    shift: Any  # f64 vec3 by surface, displacement since the start [m]
    turn: Any  # f64 mat3 by surface, rotation since the start
    velocity: Any  # f64 vec3 by surface [m s-1]
    spin: Any  # f64 vec3 by surface [rad s-1]
    centre: Any  # f64 vec3 by surface, a point of the spin axis at the start [m]
    sweep: Any  # f64 by surface, largest speed at which its shape moves [m s-1]


def allocate_walls(replicas: int, primitives: int, surfaces: int) -> Walls:
    """Fields for the walls of all replicas; at least one place of each, since a field cannot be empty."""
    bodies, pieces = replicas * max(surfaces, 1), replicas * max(primitives, 1)
    table = arrays(
        pieces,
        i32="kind surface",
        f64="ball_radius",
        f64x3="corner second third ball_centre",
        f64x4="profile",
    )
    table |= arrays(
        bodies, i32="material present moving moved", f64="sweep", f64x3="shift velocity spin centre"
    )
    return Walls(primitives, surfaces, **table, turn=ti.Matrix.field(3, 3, ti.f64, shape=bodies))


@ti.func
def plane_offset(walls: ti.template(), w, position):
    """From the closest point of the half space to the position [m]; inside it, against the normal."""
    normal = walls.second[w]
    return (position - walls.corner[w]).dot(normal) * normal


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
    return away[0] * radial / ti.max(radius, LENGTH_LEAST) + away[1] * axis


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
        offset = plane_offset(walls, w, position)
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
    seen = position
    if walls.moved[s] == 1:
        centre = walls.centre[s]
        seen = walls.turn[s].transpose() @ (position - centre - walls.shift[s]) + centre
    return seen


@ti.func
def out_of_wall_frame(walls: ti.template(), s, direction):
    """Direction in space of a direction in the frame of surface s."""
    turned = direction
    if walls.moved[s] == 1:
        turned = walls.turn[s] @ direction
    return turned


@ti.func
def surface_velocity(walls: ti.template(), s, position):
    """Velocity of the material of surface s at a position [m s-1]."""
    velocity = 0.0 * position
    if walls.moved[s] == 1:
        velocity = walls.velocity[s] + walls.spin[s].cross(position - walls.centre[s] - walls.shift[s])
    return velocity


@ti.func
def surface_of(walls: ti.template(), w):
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
            walls_out.shift[s] = walls_out.shift[s] + walls_out.velocity[s] * dt
            walls_out.turn[s] = rotation(walls_out.spin[s] * dt) @ walls_out.turn[s]
            sweep = ti.max(sweep, walls_out.sweep[s])
    replicas_out.wall_travel[r] = replicas_out.wall_travel[r] + ti.cast(sweep * dt, float)


@ti.func
def rotation(vector):
    """Rotation matrix of a rotation vector (Rodrigues)."""
    angle = vector.norm()
    axis = vector / ti.max(angle, LENGTH_LEAST)
    cross = ti.Matrix([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    identity = ti.Matrix.identity(ti.f64, 3)
    return identity + ti.sin(angle) * cross + (1.0 - ti.cos(angle)) * (cross @ cross)
