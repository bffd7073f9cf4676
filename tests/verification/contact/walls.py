"""V16: walls made of triangles act as the surfaces that they approximate.

A flat floor cut into triangles is a plane, wherever the grain meets it and while it slides and rolls across.
A cone or cylinder cut into n facets lies inside the true one by at most R (1 - cos(pi/n)); the path of a
grain that rolls down inside must approach that on the true wall as n^-2.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np

from taichi_erosion.core.setup import Floats, Laws, PrimitiveKind, PrimitiveTable, Setup
from taichi_erosion.verification.claims import Outcome, Precision, below
from tests.verification import small_scenes as small

RADIUS, DENSITY, SPEED = 1e-3, 2500.0, 0.5  # m, kg m-3, m s-1
TOUCH = small.Touch(1e8, 2.5e7, 0.7, 0.4, friction_rolling=0.1, rolling_damping=0.3)
LAWS = Laws(rolling="elastic_plastic")
CELL = 2e-3  # m, edge of the squares that are cut into triangles
LIMIT: dict[Precision, float] = {"f64": 1e-6, "f32": 1e-4}
# where the grain comes down, from a corner shared by six triangles [m]; the diagonal runs from corner to
# corner
LANDINGS = {"face": (0.7e-3, 0.3e-3), "shared edge": (1.0e-3, 0.0)}
LANDINGS |= {"diagonal edge": (1.0e-3, 1.0e-3), "corner": (0.0, 0.0)}
FACETS = (60, 120, 240, 480)  # pairs of triangles around the axis
TURN = 0.7123  # rad, where the grain starts: on no edge and no middle of a facet


@dataclass(frozen=True)
class Frustum:
    """A wall of revolution about the z axis."""

    name: str
    radius_low: float  # m, at height 0
    radius_high: float  # m
    height: float  # m


FRUSTUMS = Frustum("cone", 2e-4, 8.2e-3, 8e-3), Frustum("lying cylinder", 6e-3, 6e-3, 2e-2)


def tiled_floor() -> PrimitiveTable:
    """Squares in the plane z = 0 around the origin, each cut into two triangles."""
    triangles = []
    for x, y in CELL * (np.array(list(np.ndindex(8, 8))) - 4):
        a, b = [x, y, 0.0], [x + CELL, y, 0.0]
        c, d = [x + CELL, y + CELL, 0.0], [x, y + CELL, 0.0]
        triangles += [a + b + c, a + c + d]
    return small.primitive_table(PrimitiveKind.TRIANGLE, triangles)


def thrown(walls: PrimitiveTable, place: tuple[float, float], sideways: float) -> Setup:
    """A grain that comes down at `place`, moving sideways, and bounces, slides and rolls on."""
    impact = small.head_on(TOUCH, DENSITY, SPEED, RADIUS)
    start, velocity = [[*place, RADIUS + 1e-6]], [[sideways, 0.37 * sideways, -SPEED]]
    grain = small.spheres(start, velocity, [[0.0, 0.0, 100.0]], RADIUS, impact.mass)
    return small.sphere_setup(grain, TOUCH, impact.duration / 100.0, walls, small.GRAVITY)


def mesh_and_plane() -> Iterator[Outcome]:
    """V16."""
    falls = {"falls straight on": 0.0, "falls and runs across, first on": 0.1}
    names = [f"{fall} the {landing}" for fall in falls for landing in LANDINGS]
    places = [(place, sideways) for sideways in falls.values() for place in LANDINGS.values()]
    setups = [thrown(walls, *place) for walls in (tiled_floor(), small.FLAT) for place in places]
    for frustum in FRUSTUMS:
        ends = (frustum.radius_low, 0.0, frustum.radius_high, frustum.height)
        true = small.primitive_table(PrimitiveKind.REVOLVED, (*small.FLOOR, *ends))
        walls = (*(faceted(frustum, facets) for facets in FACETS), true)
        setups += [rolling_inside(frustum, wall) for wall in walls]
    for precision, limit in LIMIT.items():
        path = small.trace(setups, np.linspace(0.001, 0.03, 30), precision, LAWS).position[:, :, 0]
        on_mesh, on_plane, within = np.split(path, [len(places), 2 * len(places)], axis=1)
        for name, largest in zip(names, np.abs(on_mesh - on_plane).max(axis=(0, 2)) / RADIUS, strict=True):
            yield below(f"mesh and plane: grain {name}, path [radii]", largest, limit, precision)
        for frustum, paths in zip(FRUSTUMS, np.split(within, len(FRUSTUMS), axis=1), strict=True):
            yield from revolved_outcomes(frustum, paths, precision)


def faceted(frustum: Frustum, facets: int) -> PrimitiveTable:
    """The frustum as triangles whose corners lie on it."""
    angle = np.linspace(0.0, 2.0 * pi, facets + 1)
    circle = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    low, high = frustum.radius_low * circle, frustum.radius_high * circle + [0.0, 0.0, frustum.height]
    first = np.concatenate([low[:-1], low[1:], high[1:]], axis=1)
    second = np.concatenate([low[:-1], high[1:], high[:-1]], axis=1)
    return small.primitive_table(PrimitiveKind.TRIANGLE, np.concatenate([first, second]))


def rolling_inside(frustum: Frustum, walls: PrimitiveTable) -> Setup:
    """A grain let go against the wall, which rolls down it; a cylinder lies on its side."""
    impact = small.head_on(TOUCH, DENSITY, 0.1, RADIUS)
    slope = (frustum.radius_high - frustum.radius_low) / frustum.height
    lean = np.array([-1.0, slope]) / np.hypot(1.0, slope)  # inward normal in (radial, axial)
    level = 0.8 * frustum.height
    radial, axial = np.array([frustum.radius_low + slope * level, level]) + RADIUS * lean
    start = [[radial * cos(TURN), radial * sin(TURN), axial]]
    aside = 0.05 * np.array([[-sin(TURN), cos(TURN), 0.0]])  # m s-1, around the axis
    grain = small.spheres(start, aside, 0.0, RADIUS, impact.mass)
    gravity = small.GRAVITY if slope > 0.0 else (9.81, 0.0, 0.0)
    return small.sphere_setup(grain, TOUCH, impact.duration / 50.0, walls, gravity)


def revolved_outcomes(frustum: Frustum, path: Floats, precision: Precision) -> Iterator[Outcome]:
    """Path on facets against path on the true wall.

    Normals are off by up to pi/n, so a path of some radii may drift by that many times pi/n.
    """
    error = np.linalg.norm(path[:, :-1] - path[:, -1:], axis=2).max(axis=0) / RADIUS
    length = np.linalg.norm(np.diff(path[:, -1], axis=0), axis=1).sum() / RADIUS
    name = f"{frustum.name} of {FACETS[-1]} facets: path of {length:.1f} radii off the true wall [radii]"
    yield below(name, error[-1], length * pi / FACETS[-1], precision)
    order = -float(np.polyfit(np.log(FACETS), np.log(error), 1)[0])
    name = f"{frustum.name}: order at which the path off the true wall falls ({order:.1f})"
    yield below(f"{name}: what it lacks of 2", max(0.0, 2.0 - order), 0.5, precision)
