"""Triangle meshes of walls, for display only: contact uses the exact primitives."""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import Floats, PrimitiveKind, Setup, Triple

Integers = NDArray[np.int32]
Box = tuple[Triple, Triple]

SEGMENTS = 48  # facets of a full turn [1]; the chord stays within 0.2 % of the radius


@dataclass(frozen=True)
class WallMesh:
    """One named wall as triangles."""

    name: str
    vertices: Floats  # [v, 3] m
    triangles: Integers  # [t, 3] rows of vertices
    moving: bool  # whether it may move or be removed during the run


def wall_meshes(setup: Setup, bounds: Box, moving: frozenset[str] = frozenset()) -> tuple[WallMesh, ...]:
    """Triangulate every surface; planes, endless in the contact law, end at `bounds` (low, high) [m]."""
    table = setup.primitives
    meshes = []
    for index, surface in enumerate(setup.surfaces):
        rows = np.flatnonzero(table.surface == index)
        parts = [triangulate(PrimitiveKind(table.kind[row]), table.shape[row], bounds) for row in rows]
        vertices, triangles = join(parts)
        meshes.append(WallMesh(surface.name, vertices, triangles, surface.name in moving))
    return tuple(meshes)


def triangulate(kind: PrimitiveKind, shape: Floats, bounds: Box) -> tuple[Floats, Integers]:
    """Vertices [m] and triangles of one primitive, its numbers ordered as PrimitiveKind says."""
    if kind == PrimitiveKind.PLANE:
        return plane(shape[0:3], shape[3:6], bounds)
    if kind == PrimitiveKind.REVOLVED:
        return revolved(shape[0:3], shape[3:6], shape[6:10])
    return shape[0:9].reshape(3, 3), np.array([[0, 1, 2]], dtype=np.int32)


def plane(point: Floats, normal: Floats, bounds: Box) -> tuple[Floats, Integers]:
    """Rectangle of a plane that just covers the bounds.

    Along a unit direction e in the plane a box of edges L reaches  (|e_x| L_x + |e_y| L_y + |e_z| L_z) / 2
    to either side of its centre.
    """
    low, high = np.asarray(bounds)
    centre = 0.5 * (low + high)
    centre = centre - np.dot(centre - point, normal) * normal
    first, second = in_plane_directions(normal)
    along_first = 0.5 * np.dot(np.abs(first), high - low) * first
    along_second = 0.5 * np.dot(np.abs(second), high - low) * second
    corners = [-along_first - along_second, along_first - along_second, along_first + along_second]
    corners.append(along_second - along_first)
    return centre + np.array(corners), np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)


def revolved(point: Floats, axis: Floats, profile: Floats) -> tuple[Floats, Integers]:
    """Line segment turned about an axis; `profile` = radius and height of one end, then of the other [m]."""
    first, second = in_plane_directions(axis)
    turn = np.arange(SEGMENTS) * (2.0 * pi / SEGMENTS)
    spokes = np.outer(np.cos(turn), first) + np.outer(np.sin(turn), second)
    rings = [point + radius * spokes + height * axis for radius, height in profile.reshape(2, 2)]
    here = np.arange(SEGMENTS)
    after = (here + 1) % SEGMENTS
    lower = np.stack([here, after, here + SEGMENTS], axis=-1)
    upper = np.stack([after, after + SEGMENTS, here + SEGMENTS], axis=-1)
    # an end on the axis is one point: its triangles have no area
    triangles = [part for part, radius in ((lower, profile[0]), (upper, profile[2])) if radius > 0.0]
    return np.concatenate(rings), np.concatenate(triangles).astype(np.int32)


def in_plane_directions(normal: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors square to a unit normal and to each other; x and y where the normal is z."""
    start = np.array([0.0, 1.0, 0.0]) if abs(normal[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    first = np.cross(start, normal)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


def join(parts: list[tuple[Floats, Integers]]) -> tuple[Floats, Integers]:
    if not parts:
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int32)
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts[:-1]])
    triangles = [rows + start for (_, rows), start in zip(parts, starts, strict=True)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(triangles).astype(np.int32)


def section(wall: WallMesh) -> Floats:
    """Cut of a wall by the vertical plane y = 0: line segments (x, z) of both ends, [k, 2, 2] m."""
    start = wall.vertices[wall.triangles]
    end = np.roll(start, -1, axis=1)
    crosses = (start[..., 1] >= 0.0) != (end[..., 1] >= 0.0)  # none or two edges of a triangle
    start, end = start[crosses], end[crosses]
    share = -start[:, 1:2] / (end[:, 1:2] - start[:, 1:2])
    return (start + share * (end - start))[:, [0, 2]].reshape(-1, 2, 2)
