"""Walls of a scene as primitives, their bounding boxes, and the domain that holds all grains."""

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import SHAPE_NUMBERS, Floats, Motion, PrimitiveKind, PrimitiveTable, Servo
from taichi_erosion.scene.schema.fields import Vector, unit_vector
from taichi_erosion.scene.schema.geometry import UPWARDS, Box, Cone, Cylinder, Disc, Funnel, Hull, Mesh, Plane
from taichi_erosion.scene.schema.scene import Movement, Scene

MARGIN_OPEN = 30.0  # side margin over the apparatus where a plane lets splashed grains roll away [1]
MARGIN_CLOSED = 0.5  # side margin otherwise [1]
MARGIN_HEIGHT = 0.5  # margin above and below over the height of the apparatus [1]
MARGIN_RADII = 20.0  # least margin, in largest radii [1]
MARGIN_RADII_OPEN = 500.0  # likewise to the sides where a plane lets grains slide away [1]
MOST_TRIANGLES = 500_000
FLAT = 1e-3  # volume of a mesh over that of its box, below which nothing lies inside [1]

Row = tuple[PrimitiveKind, tuple[float, ...]]


def has_open_domain(scene: Scene, walls: PrimitiveTable) -> bool:
    """Whether grains that leave the domain are taken out: as stated, or where no half space holds them up."""
    if scene.domain.outside is not None or scene.wind is not None:
        return scene.domain.outside == "remove"
    normals = walls.shape[walls.kind == PrimitiveKind.PLANE, 3:6]
    return not np.any(normals @ scene.gravity.direction < 0.0) or scene.gravity.magnitude == 0.0


def domain_box(scene: Scene, centres: Floats, radius_largest: float) -> tuple[Vector, Vector]:
    """Low and high corner [m] around walls, starting grains and the travel of moving walls, with a margin.

    The margin leaves room for a spreading heap.
    """
    boxes = [bounding_box_of_wall(scene, name) for name in scene.geometry] + [bounding_box(centres)]
    low = np.min(boxes, axis=0)[0] + farthest_wall_shift(scene, np.minimum)
    high = np.max(boxes, axis=0)[1] + farthest_wall_shift(scene, np.maximum)
    is_open = any(isinstance(wall, Plane) for wall in scene.geometry.values())
    share = MARGIN_OPEN if is_open else MARGIN_CLOSED
    least = MARGIN_RADII_OPEN if is_open else MARGIN_RADII
    extent = high - low
    side = max(share * max(extent[0], extent[1]), least * radius_largest)
    margin = np.maximum((side, side, MARGIN_HEIGHT * extent[2]), MARGIN_RADII * radius_largest)
    (x, y, z), (a, b, c) = (low - margin).tolist(), (high + margin).tolist()
    if scene.domain.period is not None:
        x, y, a, b = 0.0, 0.0, *scene.domain.period
    return (x, y, z), (a, b, c)


def farthest_wall_shift(scene: Scene, extreme: np.ufunc) -> Floats:
    """Farthest shift of a wall along each coordinate, towards the low or the high side [m].

    That of servos, which press against grains, is left out.
    """
    farthest = np.zeros(3)
    reached: dict[str, Floats] = {}
    orders: dict[str, tuple[Movement, Floats, float]] = {}  # with the shift before, and the time since
    for stage in scene.stages:
        orders |= {k: (order, reached.get(k, np.zeros(3)), 0.0) for k, order in stage.move.items()}
        for name, (order, before, time) in orders.items():
            orders[name] = order, before, time + stage.duration_max
            path = before + tabulated_wall_shifts(order, time + stage.duration_max)
            reached[name] = path[-1]
            farthest = extreme(farthest, extreme.reduce(path))
    return farthest


def tabulated_wall_shifts(order: Movement, duration: float) -> Floats:
    """Shifts of a moved wall [n, 3] m at the times of its table, and at the end of a duration [s]."""
    rows = np.array(order.table or [(time, *order.velocity, *order.spin) for time in (0.0, duration)])
    time, velocity = np.append(rows[:, 0], max(duration, rows[-1, 0])), np.vstack([rows, rows[-1:]])[:, 1:4]
    return np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time)[:, np.newaxis], axis=0)


def motion_of_wall_order(order: Movement) -> Motion:
    target, servo = order.force if order.torque is None else order.torque, None
    if target is not None:
        servo = Servo(order.torque is not None, target, unit_vector(order.axis), order.fastest)
    return Motion(order.velocity, order.spin, order.centre, order.table, servo)


def wall_motions(scene: Scene) -> list[Motion]:
    return [motion_of_wall_order(order) for stage in scene.stages for order in stage.move.values()]


def primitive_table(scene: Scene, names: list[str]) -> PrimitiveTable:
    """Primitives of the named walls, in that order."""
    kinds, surfaces, shapes = [], [], []
    for surface, name in enumerate(names):
        for kind, numbers in primitives_of_wall(scene, name):
            kinds.append(kind)
            surfaces.append(surface)
            shapes.append(numbers + (0.0,) * (SHAPE_NUMBERS - len(numbers)))
    shape = np.array(shapes, dtype=np.float64).reshape(-1, SHAPE_NUMBERS)
    return PrimitiveTable(np.array(kinds, dtype=np.int32), np.array(surfaces, dtype=np.int32), shape)


def primitives_of_wall(scene: Scene, name: str) -> list[Row]:
    wall = scene.geometry[name]
    if isinstance(wall, Plane):
        return [(PrimitiveKind.PLANE, (*wall.point, *unit_vector(wall.normal)))]
    if isinstance(wall, Box):
        rows: list[Row] = []
        for face in wall.faces:
            side = "xyz".index(face[0])
            inwards = [0.0, 0.0, 0.0]
            inwards[side] = 1.0 if face.endswith("low") else -1.0
            rows.append((PrimitiveKind.PLANE, (*(wall.low if face.endswith("low") else wall.high), *inwards)))
        return rows
    if isinstance(wall, Mesh):
        triangles = read_mesh_triangles(scene, f"geometry.{name}", wall).reshape(-1, 9)
        return [(PrimitiveKind.TRIANGLE, tuple(corners)) for corners in triangles.tolist()]
    return [(PrimitiveKind.REVOLVED, numbers) for numbers in surface_of_revolution_rows(wall)]


def distance_to_wall(scene: Scene, name: str, points: Floats) -> Floats:
    """Distance of points [n, 3] m from a wall, [n] m; inf from a mesh, negative behind a plane."""
    distance = np.full(len(points), np.inf)
    for kind, row in primitives_of_wall(scene, name) if not isinstance(scene.geometry[name], Mesh) else ():
        arm, axis = points - row[:3], np.array(row[3:6])
        along = arm @ axis
        if kind == PrimitiveKind.REVOLVED:  # a segment in the plane of radius and height
            start, step = np.array(row[6:8]), np.subtract(row[8:10], row[6:8])
            place = np.column_stack([np.linalg.norm(arm - np.outer(along, axis), axis=1), along]) - start
            share = np.clip(place @ step / (step @ step), 0.0, 1.0)
            along = np.linalg.norm(place - np.outer(share, step), axis=1)
        distance = np.minimum(distance, along)
    return distance


def surface_of_revolution_rows(wall: Disc | Cylinder | Cone | Funnel) -> list[tuple[float, ...]]:
    """Segments turned about an axis: axis point, unit axis, radius and height of both ends."""
    if isinstance(wall, Funnel):
        r, stem = wall.outlet_radius, wall.stem_length
        cone = (*wall.outlet, *UPWARDS, r, stem, wall.rim_radius, stem + wall.cone_height)
        return [(*wall.outlet, *UPWARDS, r, 0.0, r, stem), cone] if stem > 0.0 else [cone]
    axis = (*wall.centre, *unit_vector(wall.axis))
    if isinstance(wall, Disc):
        return [(*axis, wall.hole, 0.0, wall.radius, 0.0)]
    if isinstance(wall, Cylinder):
        return [(*axis, wall.radius, 0.0, wall.radius, wall.length)]
    return [(*axis, wall.radius_low, 0.0, wall.radius_high, wall.length)]


def read_mesh_triangles(scene: Scene, path: str, mesh: Hull) -> Floats:
    """Corners of a mesh file's triangles, [t, 3, 3] m; `path` names the mesh in the scene."""
    # the import takes a third of a second, which scenes without meshes are spared
    import trimesh

    file, entry = scene.folder / mesh.file, f"{path}.file = '{mesh.file}'"
    if not file.is_file():
        raise BadInput(f"{entry}: no such file beside the scene")
    try:
        triangles = np.asarray(trimesh.load_mesh(file).triangles, dtype=np.float64)
    except Exception as error:  # the readers of the many formats raise whatever their parsers raise
        reason = str(error).splitlines() or [type(error).__name__]
        raise BadInput(f"{entry} is not a triangle mesh: {reason[0][:120]}") from None
    if triangles.shape[1:] != (3, 3) or not 0 < len(triangles) <= MOST_TRIANGLES:
        raise BadInput(f"{entry} needs 1 to {MOST_TRIANGLES} triangles in space")
    if not np.isfinite(triangles).all():
        raise BadInput(f"{entry} has corners that are not finite")
    return triangles * mesh.scale + np.array(mesh.translate)


def closed_mesh(scene: Scene, path: str, mesh: Hull) -> Floats:
    """Triangles [t, 3, 3] m of a mesh that has an inside. Raises BadInput where it has none."""
    import trimesh

    triangles = read_mesh_triangles(scene, path, mesh)
    sides = np.ptp(bounding_box(triangles), axis=0)
    solid = trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles / sides.max()))
    is_closed = solid.is_watertight and solid.is_winding_consistent
    if not is_closed or abs(solid.volume) < FLAT * np.prod(sides / sides.max()):
        words = "has no inside: it is open, flat, or its triangles face both ways"
        raise BadInput(f"{path}.file = '{mesh.file}' {words}")
    return triangles


def mesh_depths(triangles: Floats, points: Floats) -> Floats:
    """Depth of points [n, 3] m inside a closed mesh [n] m, 0 outside, where solid angles W add up to nothing.

        tan(W / 2) = a . (b x c) / (|a| |b| |c| + (a . b) |c| + (b . c) |a| + (c . a) |b|)

    with a, b, c the corners of a triangle as seen from the point.
    Reference: Van Oosterom & Strackee (1983), IEEE Trans. Biomed. Eng. 30, 125.
    """
    import trimesh

    a, b, c = np.moveaxis(triangles - points[:, None, None], 2, 0)
    (p, q, r), dot = (np.linalg.norm(arm, axis=-1) for arm in (a, b, c)), "nti, nti -> nt"
    below = p * q * r + np.einsum(dot, a, b) * r + np.einsum(dot, b, c) * p + np.einsum(dot, c, a) * q
    angle = 2.0 * np.arctan2(np.einsum(dot, a, np.cross(b, c)), below).sum(axis=1)
    depth, inside = np.zeros(len(points)), np.abs(angle) > 2.0 * np.pi
    viewpoints = np.repeat(points[inside], len(triangles), axis=0)
    nearest = trimesh.triangles.closest_point(np.tile(triangles, (inside.sum(), 1, 1)), viewpoints)
    depth[inside] = np.linalg.norm(nearest - viewpoints, axis=1).reshape(-1, len(triangles)).min(axis=1)
    return depth


def bounding_box_of_wall(scene: Scene, name: str) -> Floats:
    """Low and high corner [2, 3] m of the box around a wall; of a plane, only its point."""
    wall = scene.geometry[name]
    if isinstance(wall, Plane):
        return bounding_box(np.array([wall.point]))
    if isinstance(wall, Box):
        return bounding_box(np.array([wall.low, wall.high]))
    if isinstance(wall, Mesh):
        return bounding_box(read_mesh_triangles(scene, f"geometry.{name}", wall))
    corners = []  # of a surface of revolution: a circle of radius r reaches r sqrt(1 - axis_k^2) along k
    for row in surface_of_revolution_rows(wall):
        point, axis = np.array(row[0:3]), np.array(row[3:6])
        for radius, height in (row[6:8], row[8:10]):
            reach = radius * np.sqrt(np.maximum(1.0 - axis**2, 0.0))
            corners += [point + height * axis - reach, point + height * axis + reach]
    return bounding_box(np.array(corners))


def bounding_box(points: Floats) -> Floats:
    """Low and high corner [2, 3] m of the box around points [..., 3] m."""
    points = points.reshape(-1, 3)
    return np.array([points.min(axis=0), points.max(axis=0)])
