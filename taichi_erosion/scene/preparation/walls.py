"""Walls of a scene as primitives, their bounding boxes, and the domain that no grain may leave."""

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import SHAPE_NUMBERS, Floats, PrimitiveKind, PrimitiveTable
from taichi_erosion.scene.schema.fields import Vector, unit_vector
from taichi_erosion.scene.schema.geometry import UPWARDS, Box, Cone, Cylinder, Disc, Funnel, Mesh, Plane
from taichi_erosion.scene.schema.scene import Scene

MARGIN_OPEN = 30.0  # side margin over the apparatus where a plane lets splashed grains roll away [1]
MARGIN_CLOSED = 0.5  # side margin otherwise [1]
MARGIN_HEIGHT = 0.5  # margin above and below over the height of the apparatus [1]
MARGIN_RADII = 20.0  # least margin, in largest radii [1]
MARGIN_RADII_OPEN = 500.0  # likewise to the sides where a plane lets grains slide away [1]
TRAY = "tray below"  # on which grains rest that fell off the disc of a heap
CONE_RADII = 2.0  # height of a cone of n poured grains at 45 deg over the radius and n^(1/3) [1]
TRAY_RADII = 2.0  # between tray and end of the domain, in largest radii [1]
MOST_TRIANGLES = 500_000

Row = tuple[PrimitiveKind, tuple[float, ...]]


def heap_disc(scene: Scene) -> Disc | None:
    """The disc on which a measure looks for a heap, where grains may fall off past all walls."""
    walls = scene.geometry
    if scene.wind is not None or any(isinstance(wall, Plane | Box) for wall in walls.values()):
        return None
    plates = (walls.get(order.plate or "") for order in scene.measure.values())
    return next((plate for plate in plates if isinstance(plate, Disc)), None)


def with_tray(scene: Scene, domain: tuple[Vector, Vector], radius_largest: float) -> Scene:
    """The scene with a tray under such a disc, within the domain: fallen grains come to rest on it.

    Measures of the heap leave them out. The name of the tray is none that a scene can have.
    """
    disc = heap_disc(scene)
    if disc is None:
        return scene
    margin = TRAY_RADII * radius_largest
    corners = zip(("low", "high"), np.add(domain, [[margin], [-margin]]), strict=True)
    ends = {name: tuple(corner.tolist()) for name, corner in corners}
    tray = Box.model_validate({"shape": "box", "material": disc.material, **ends})
    return scene.model_copy(update={"geometry": scene.geometry | {TRAY: tray}})


def domain_box(scene: Scene, centres: Floats, radius_largest: float) -> tuple[Vector, Vector]:
    """Low and high corner [m] around walls, starting grains and the travel of moving walls, with a margin.

    A grain found outside is lost, and the run stops; the margin leaves room for a spreading heap.
    """
    boxes = [wall_bounds(scene, name) for name in scene.geometry] + [bounds_of(centres)]
    low = np.min(boxes, axis=0)[0] + travel(scene, np.minimum)
    high = np.max(boxes, axis=0)[1] + travel(scene, np.maximum)
    is_open = any(isinstance(wall, Plane) for wall in scene.geometry.values())
    share = MARGIN_OPEN if is_open else MARGIN_CLOSED
    least = MARGIN_RADII_OPEN if is_open else MARGIN_RADII
    extent = high - low
    side = max(share * max(extent[0], extent[1]), least * radius_largest)
    margin = np.maximum((side, side, MARGIN_HEIGHT * extent[2]), MARGIN_RADII * radius_largest)
    if heap_disc(scene) is not None:  # all grains find room below it
        margin[2] = max(margin[2], CONE_RADII * len(centres) ** (1.0 / 3.0) * radius_largest)
    (x, y, z), (a, b, c) = (low - margin).tolist(), (high + margin).tolist()
    return (x, y, z), (a, b, c)


def travel(scene: Scene, extreme: np.ufunc) -> Floats:
    """Farthest shift of a wall along each coordinate, towards the low or the high side [m]."""
    farthest = np.zeros(3)
    reached: dict[str, Floats] = {}
    velocity: dict[str, Floats] = {}
    for stage in scene.stages:
        velocity |= {name: np.array(order.velocity) for name, order in stage.move.items()}
        for name, v in velocity.items():
            reached[name] = reached.get(name, np.zeros(3)) + v * stage.duration_max
            farthest = extreme(farthest, reached[name])
    return farthest


def primitive_table(scene: Scene, names: list[str]) -> PrimitiveTable:
    """Primitives of the named walls, in that order."""
    kinds, surfaces, shapes = [], [], []
    for surface, name in enumerate(names):
        for kind, numbers in wall_rows(scene, name):
            kinds.append(kind)
            surfaces.append(surface)
            shapes.append(numbers + (0.0,) * (SHAPE_NUMBERS - len(numbers)))
    shape = np.array(shapes, dtype=np.float64).reshape(-1, SHAPE_NUMBERS)
    return PrimitiveTable(np.array(kinds, dtype=np.int32), np.array(surfaces, dtype=np.int32), shape)


def wall_rows(scene: Scene, name: str) -> list[Row]:
    """Primitives of one wall."""
    wall = scene.geometry[name]
    if isinstance(wall, Plane):
        return [(PrimitiveKind.PLANE, (*wall.point, *unit_vector(wall.normal)))]
    if isinstance(wall, Box):
        return box_rows(wall)
    if isinstance(wall, Mesh):
        triangles = mesh_triangles(scene, name, wall).reshape(-1, 9)
        return [(PrimitiveKind.TRIANGLE, tuple(corners)) for corners in triangles.tolist()]
    return [(PrimitiveKind.REVOLVED, numbers) for numbers in revolved_rows(wall)]


def distance_to_wall(scene: Scene, name: str, points: Floats) -> Floats:
    """Distance of points [n, 3] m from a wall, [n] m; inf from a mesh, negative behind a plane."""
    found = np.full(len(points), np.inf)
    for kind, row in wall_rows(scene, name) if not isinstance(scene.geometry[name], Mesh) else ():
        arm, axis = points - row[:3], np.array(row[3:6])
        along = arm @ axis
        if kind == PrimitiveKind.REVOLVED:  # a segment in the plane of radius and height
            start, step = np.array(row[6:8]), np.subtract(row[8:10], row[6:8])
            place = np.column_stack([np.linalg.norm(arm - np.outer(along, axis), axis=1), along]) - start
            share = np.clip(place @ step / (step @ step), 0.0, 1.0)
            along = np.linalg.norm(place - np.outer(share, step), axis=1)
        found = np.minimum(found, along)
    return found


def box_rows(box: Box) -> list[Row]:
    """Faces of a box as planes that look inwards."""
    rows: list[Row] = []
    for face in box.faces:
        side = "xyz".index(face[0])
        inwards = [0.0, 0.0, 0.0]
        inwards[side] = 1.0 if face.endswith("low") else -1.0
        rows.append((PrimitiveKind.PLANE, (*(box.low if face.endswith("low") else box.high), *inwards)))
    return rows


def revolved_rows(wall: Disc | Cylinder | Cone | Funnel) -> list[tuple[float, ...]]:
    """Segments turned about an axis: axis point, unit axis, radius and height of both ends."""
    if isinstance(wall, Funnel):
        r, stem = wall.outlet_radius, wall.stem_length
        cone = (*wall.outlet, *UPWARDS, r, stem, wall.rim_radius, stem + wall.cone_height)
        return [(*wall.outlet, *UPWARDS, r, 0.0, r, stem), cone] if stem > 0.0 else [cone]
    axis = (*wall.centre, *unit_vector(wall.axis))
    if isinstance(wall, Disc):
        return [(*axis, 0.0, 0.0, wall.radius, 0.0)]
    if isinstance(wall, Cylinder):
        return [(*axis, wall.radius, 0.0, wall.radius, wall.length)]
    return [(*axis, wall.radius_low, 0.0, wall.radius_high, wall.length)]


def mesh_triangles(scene: Scene, name: str, wall: Mesh) -> Floats:
    """Corners of a mesh file's triangles, [t, 3, 3] m."""
    # the import takes a third of a second, which scenes without meshes are spared
    import trimesh

    path, told = scene.folder / wall.file, f"geometry.{name}.file = '{wall.file}'"
    if not path.is_file():
        raise BadInput(f"{told}: no such file beside the scene")
    try:
        triangles = np.asarray(trimesh.load_mesh(path).triangles, dtype=np.float64)
    except Exception as error:  # the readers of the many formats raise whatever their parsers raise
        reason = str(error).splitlines() or [type(error).__name__]
        raise BadInput(f"{told} is not a triangle mesh: {reason[0][:120]}") from None
    if triangles.shape[1:] != (3, 3) or not 0 < len(triangles) <= MOST_TRIANGLES:
        raise BadInput(f"{told} needs 1 to {MOST_TRIANGLES} triangles in space")
    if not np.isfinite(triangles).all():
        raise BadInput(f"{told} has corners that are not finite")
    return triangles * wall.scale + np.array(wall.translate)


def wall_bounds(scene: Scene, name: str) -> Floats:
    """Low and high corner [2, 3] m of the box around a wall; of a plane, only its point."""
    wall = scene.geometry[name]
    if isinstance(wall, Plane):
        return bounds_of(np.array([wall.point]))
    if isinstance(wall, Box):
        return bounds_of(np.array([wall.low, wall.high]))
    if isinstance(wall, Mesh):
        return bounds_of(mesh_triangles(scene, name, wall).reshape(-1, 3))
    corners = []  # of a surface of revolution: a circle of radius r reaches r sqrt(1 - axis_k^2) along k
    for row in revolved_rows(wall):
        point, axis = np.array(row[0:3]), np.array(row[3:6])
        for radius, height in (row[6:8], row[8:10]):
            reach = radius * np.sqrt(np.maximum(1.0 - axis**2, 0.0))
            corners += [point + height * axis - reach, point + height * axis + reach]
    return bounds_of(np.array(corners))


def bounds_of(points: Floats) -> Floats:
    """Low and high corner [2, 3] m of the box around points."""
    return np.array([points.min(axis=0), points.max(axis=0)])
