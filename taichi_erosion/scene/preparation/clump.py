"""Clumps, rigid grains made of several spheres: templates, mass and principal inertia.

A template is written in nominal diameters d; volumes then come in d^3 and moments of inertia in rho d^5.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import sqrt

import numpy as np
import scipy

from taichi_erosion.core.setup import Floats
from taichi_erosion.scene.schema.fields import Vector
from taichi_erosion.scene.schema.grains import Clump, Grains

MOST_BODIES = 1024  # kept: a plan of runs has one for every strength of an effect on the shape
VOXELS_ACROSS = 160  # cells along the longest side of a body: the volume of a sphere is right to 1e-4 [1]
SPHERE_REACH = 0.5  # radius of a sphere over its diameter [1]

TETRAHEDRON: tuple[Vector, ...] = ((1.0, 1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0))
TRIANGLE: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (-0.5, sqrt(0.75), 0.0), (-0.5, -sqrt(0.75), 0.0))
PAIR: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
CORNERS = {"pair": PAIR, "tripod": TRIANGLE, "tetrahedron": TETRAHEDRON}

Sphere = tuple[Vector, float]


@dataclass(frozen=True)
class Body:
    """A template in its principal frame, for nominal diameter 1 and density 1."""

    offset: Floats  # [s, 3] sphere centres from the centre of mass, principal frame
    radius: Floats  # [s]
    volume: float
    inertia: Floats  # [3] principal moments
    centre: Floats  # [3] centre of mass in the template's frame
    rotation: "scipy.spatial.transform.Rotation"  # principal frame to template frame
    reach: float  # distance from the centre of mass to the farthest surface point


def template_spheres(clump: Clump) -> tuple[Sphere, ...]:
    """Spheres of a template; a shipped one has n equal touching spheres and the volume of one of diameter d.

    n (2 r)^3 = 1, so r = n^(-1/3) / 2; neighbours are 2 r apart.
    """
    if clump.template is None:
        return tuple((sphere.offset, sphere.radius) for sphere in clump.spheres)
    corners = np.array(CORNERS[clump.template])
    radius = 0.5 * len(corners) ** (-1.0 / 3.0)
    stretch = 2.0 * radius / float(np.linalg.norm(corners[0] - corners[1]))
    return tuple(((x, y, z), radius) for x, y, z in (corners * stretch).tolist())


def reach_over_diameter(grains: Grains) -> float:
    """Bounding radius of a grain over its nominal diameter [1]."""
    return body_of(grains.clump).reach if grains.clump else SPHERE_REACH


def body_of(clump: Clump) -> Body:
    """Mass properties of a template."""
    return quadrature(template_spheres(clump))


@lru_cache(maxsize=MOST_BODIES)
def quadrature(spheres: tuple[Sphere, ...]) -> Body:
    """Volume, centre and inertia of a union of spheres, by counting cells with their centre in any sphere.

    I = sum over cells of h^3 [(x.x) 1 - x x^T] + V h^2 / 6, x from the centre of mass, h the cell size;
    the last term is the moment of the cells themselves.
    """
    centres = np.array([offset for offset, _ in spheres])
    radius = np.array([r for _, r in spheres])
    low, high = (centres - radius[:, None]).min(axis=0), (centres + radius[:, None]).max(axis=0)
    cell = float((high - low).max()) / VOXELS_ACROSS
    points = cells_inside(centres, radius, low, high, cell)
    volume = len(points) * cell**3
    centre = points.mean(axis=0)
    second = (points - centre).T @ (points - centre) * cell**3
    tensor = np.trace(second) * np.eye(3) - second + volume * cell**2 / 6.0 * np.eye(3)
    moments, axes = np.linalg.eigh(tensor)
    if np.linalg.det(axes) < 0.0:
        axes[:, 2] *= -1.0
    offset = (centres - centre) @ axes
    reach = float((np.linalg.norm(offset, axis=1) + radius).max())
    turned = scipy.spatial.transform.Rotation.from_matrix(axes)
    return Body(offset, radius, volume, moments, centre, turned, reach)


def cells_inside(centres: Floats, radius: Floats, low: Floats, high: Floats, cell: float) -> Floats:
    """Centres of the cells inside the union, [cells, 3]; cells lie evenly about the middle of the box."""
    middle, counts = 0.5 * (low + high), np.ceil((high - low) / cell).astype(int)
    x, y, z = (middle[k] + (np.arange(n) - 0.5 * (n - 1)) * cell for k, n in enumerate(counts))
    inside = np.zeros(tuple(counts), dtype=bool)
    for centre, r in zip(centres, radius, strict=True):
        near = tuple(
            slice(*np.searchsorted(axis, (at - r - cell, at + r + cell)))
            for axis, at in zip((x, y, z), centre, strict=True)
        )
        a, b, c = (axis[part] - at for axis, part, at in zip((x, y, z), near, centre, strict=True))
        inside[near] |= a[:, None, None] ** 2 + b[:, None] ** 2 + c**2 <= r * r
    i, j, k = np.nonzero(inside)
    return np.column_stack([x[i], y[j], z[k]])
