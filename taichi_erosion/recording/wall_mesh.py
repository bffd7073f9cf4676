"""Triangle meshes of walls, for display only: contact uses the exact primitives."""

from dataclasses import dataclass

import numpy as np

from taichi_erosion.core.setup import Floats, Integers, PrimitiveKind, Setup, Triple

Box = tuple[Triple, Triple]

SEGMENTS = 48  # facets of a full turn [1]; the chord stays within 0.2 % of the radius


@dataclass(frozen=True)
class WallMesh:
    name: str
    vertices: Floats  # [v, 3] m
    triangles: Integers  # [t, 3] rows of vertices
    moving: bool  # whether it may move or be removed during the run


def wall_meshes(setup: Setup, bounds: Box, moving: frozenset[str] = frozenset()) -> tuple[WallMesh, ...]:
    """Triangulate every surface; planes, endless in the contact law, end at `bounds` (low, high) [m]."""
    import trimesh

    table = setup.primitives
    meshes = []
    for index, surface in enumerate(setup.surfaces):
        rows = np.flatnonzero(table.surface == index)
        parts = [triangulate(PrimitiveKind(table.kind[row]), table.shape[row], bounds) for row in rows]
        if parts:
            joined = trimesh.util.append_faces(*zip(*parts, strict=True))
            vertices, triangles = np.asarray(joined[0], np.float64), np.asarray(joined[1], np.int32)
            meshes.append(WallMesh(surface.name, vertices, triangles, surface.name in moving))
    return tuple(meshes)


def triangulate(kind: PrimitiveKind, shape: Floats, bounds: Box) -> tuple[Floats, Integers]:
    """Vertices [m] and triangles of one primitive, its numbers ordered as PrimitiveKind says."""
    import trimesh

    if kind == PrimitiveKind.PLANE:
        return plane_mesh(shape[0:3], shape[3:6], bounds)
    if kind == PrimitiveKind.REVOLVED:
        pose = np.asarray(trimesh.geometry.align_vectors((0.0, 0.0, 1.0), shape[3:6]))
        pose[:3, 3] = shape[0:3]
        # a line segment turned about an axis: radius and height of one end, then of the other
        mesh = trimesh.creation.revolve(shape[6:10].reshape(2, 2), sections=SEGMENTS, transform=pose)
        return np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int32)
    return shape[0:9].reshape(3, 3), np.array([[0, 1, 2]], dtype=np.int32)


def plane_mesh(point: Floats, normal: Floats, bounds: Box) -> tuple[Floats, Integers]:
    """Rectangle of a plane that just covers the bounds.

    Along a unit direction e in the plane a box of edges L reaches  (|e_x| L_x + |e_y| L_y + |e_z| L_z) / 2
    to either side of its centre.
    """
    import trimesh

    low, high = np.asarray(bounds)
    centre = 0.5 * (low + high)
    centre = centre - np.dot(centre - point, normal) * normal
    edges = np.asarray(trimesh.geometry.align_vectors((0.0, 0.0, 1.0), normal))[:3, :2].T
    first, second = 0.5 * (np.abs(edges) @ (high - low))[:, None] * edges
    corners = np.array([-first - second, first - second, first + second, second - first])
    return centre + corners, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)


def wall_cut_lines(wall: WallMesh) -> Floats:
    """Cut of a wall by the vertical plane y = 0: line segments (x, z) of both ends, [k, 2, 2] m."""
    import trimesh

    mesh = trimesh.Trimesh(wall.vertices, wall.triangles, process=False)
    cut = trimesh.intersections.mesh_plane(mesh, (0.0, 1.0, 0.0), (0.0, 0.0, 0.0))
    return np.asarray(cut)[:, :, [0, 2]].reshape(-1, 2, 2)
