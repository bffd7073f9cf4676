"""Sizes and shapes of grains: range, nominal value and samples of each size law; clumps of several spheres.

The template of a clump is written in nominal diameters d; volumes then come in d^3, inertia in rho d^5.
"""

import tomllib
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from math import exp, log, sqrt

import numpy as np
import scipy

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats
from taichi_erosion.scene.schema.fields import Vector
from taichi_erosion.scene.schema.grains import Clump, Grains, Lognormal, Monodisperse, Sieve, SieveRow, Size
from taichi_erosion.scene.schema.scene import Scene

MOST_BODIES = 1024  # kept: a plan of runs has one for every strength of an effect on the shape
VOXELS_ACROSS = 160  # cells along the longest side of a body: the volume of a sphere is right to 1e-4 [1]
SPHERE_REACH = 0.5  # radius of a sphere over its diameter [1]

TETRAHEDRON: tuple[Vector, ...] = ((1.0, 1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0))
TRIANGLE: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (-0.5, sqrt(0.75), 0.0), (-0.5, -sqrt(0.75), 0.0))
PAIR: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
CORNERS = {"pair": PAIR, "tripod": TRIANGLE, "tetrahedron": TETRAHEDRON}

Sphere = tuple[Vector, float]


@cache
def read_sieve_table(name: str) -> tuple[SieveRow, ...]:
    """Rows of a shipped sieve table: low [m], high [m], mass."""
    folder = files("taichi_erosion.scene") / "tables"
    names = sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir())
    if name not in names:
        raise BadInput(f"grains.size.table = '{name}' is not among the shipped tables: {', '.join(names)}")
    content = (folder / f"{name}.toml").read_text(encoding="utf-8")
    return tuple((float(low), float(high), float(mass)) for low, high, mass in tomllib.loads(content)["rows"])


def sieve_size_classes(size: Sieve) -> Floats:
    """Size classes after cutting and scaling, [classes, 3]: low [m], high [m], share of the mass [1].

    Mass is uniform over ln d inside a class, so a cut keeps ln(b'/a') / ln(b/a) of its mass.
    """
    rows = size.rows or read_sieve_table(size.table or "")
    low, high = size.low or 0.0, size.high or np.inf
    cut_rows = []
    for a, b, mass in rows:
        cut_a, cut_b = max(a, low), min(b, high)
        if cut_a < cut_b and mass > 0.0:
            cut_rows.append((cut_a * size.scale, cut_b * size.scale, mass * log(cut_b / cut_a) / log(b / a)))
    if not cut_rows:
        raise BadInput("grains.size: no mass is left between low and high")
    classes = np.array(cut_rows)
    classes[:, 2] /= classes[:, 2].sum()
    return classes


def size_range(size: Size | Grains) -> tuple[float, float]:
    """Smallest and largest diameter that a size law, or any of several kinds, can give [m]."""
    if isinstance(size, Grains):
        low, high = zip(*(size_range(part.size) for part in size.parts.values()), strict=True)
        return min(low), max(high)
    if isinstance(size, Monodisperse):
        return size.diameter, size.diameter
    if isinstance(size, Lognormal):
        return size.low, size.high
    classes = sieve_size_classes(size)
    return float(classes[0, 0]), float(classes[-1, 1])


def nominal_diameter(size: Size | Grains) -> float:
    """The diameter d that names the scene [m]: the diameter, the median, or the sieve curve's mass median.

    Of several kinds it is their geometric mean by mass.
    """
    if isinstance(size, Grains):
        of_kinds = [(part.share, nominal_diameter(part.size)) for part in size.parts.values()]
        return of_kinds[0][1] if len(of_kinds) == 1 else exp(sum(w * log(d) for w, d in of_kinds))
    if isinstance(size, Monodisperse):
        return size.diameter
    if isinstance(size, Lognormal):
        return size.median
    classes = sieve_size_classes(size)
    below = np.concatenate([[0.0], np.cumsum(classes[:, 2])])
    row = min(int(np.searchsorted(below, 0.5)) - 1, len(classes) - 1)
    low, high, share = classes[row]
    return float(low * (high / low) ** ((0.5 - below[row]) / share))


def sample_diameters(size: Size, count: int, generator: np.random.Generator) -> Floats:
    """Diameters of `count` grains in random order [m]."""
    if isinstance(size, Monodisperse):
        return np.full(count, size.diameter)
    if isinstance(size, Lognormal):
        return lognormal_quantile(size, generator.random(count))
    return sieve_quantile(sieve_size_classes(size), generator.random(count), generator.random(count))


def lognormal_quantile(size: Lognormal, quantile: Floats) -> Floats:
    """Inverse of the truncated lognormal distribution of numbers [m]."""
    if size.sigma_log == 0.0:
        return np.full(len(quantile), size.median)
    below = scipy.special.ndtr(log(size.low / size.median) / size.sigma_log)
    above = scipy.special.ndtr(log(size.high / size.median) / size.sigma_log)
    deviate = scipy.special.ndtri(below + quantile * (above - below))
    return np.clip(size.median * np.exp(size.sigma_log * deviate), size.low, size.high)


def sieve_quantile(classes: Floats, quantile_class: Floats, quantile: Floats) -> Floats:
    """Diameters whose masses follow a sieve curve [m].

    Mass uniform over ln d means numbers proportional to d^-3 per ln d: class [a, b] with share w of the mass
    holds numbers in proportion to  w (a^-3 - b^-3) / (3 ln(b/a));  inside it  d^-3 = a^-3 - q (a^-3 - b^-3).
    """
    low, high, share = classes.T
    span = low**-3 - high**-3
    numbers = share * span / np.log(high / low)
    edges = np.cumsum(numbers) / numbers.sum()
    row = np.minimum(np.searchsorted(edges, quantile_class, side="right"), len(classes) - 1)
    return np.clip((low[row] ** -3 - quantile * span[row]) ** (-1.0 / 3.0), low[row], high[row])


def mean_cubed_diameter(size: Size) -> float:
    """Mean of d^3 over the grains [m3]; times pi/6 it is the mean volume of a sphere."""
    if isinstance(size, Monodisperse):
        return size.diameter**3
    if isinstance(size, Lognormal):
        return lognormal_mean_d_cubed(size)
    low, high, share = sieve_size_classes(size).T
    return 1.0 / float(np.sum(share * (low**-3 - high**-3) / (3.0 * np.log(high / low))))


def kind_shares(scene: Scene) -> dict[str, float]:
    """Shares of the number of grains by kind [1], from shares of the mass: n ~ w / (rho E[d^3])."""
    weights = {}
    for name, part in scene.grains.parts.items():
        weights[name] = part.share / (scene.materials[name].density * mean_cubed_diameter(part.size))
    return {name: weight / sum(weights.values()) for name, weight in weights.items()}


def scene_mean_cubed_diameter(scene: Scene) -> float:
    """Mean of d^3 over the grains of a scene [m3]."""
    parts = scene.grains.parts
    return sum(share * mean_cubed_diameter(parts[name].size) for name, share in kind_shares(scene).items())


def grain_count_of_kinds(scene: Scene) -> dict[str, int]:
    """Numbers of grains by kind; they add up to the count of the scene."""
    edges = np.rint(scene.grains.count * np.cumsum([0.0, *kind_shares(scene).values()])).astype(int)
    return dict(zip(scene.grains.parts, np.diff(edges).tolist(), strict=True))


def lognormal_mean_d_cubed(size: Lognormal) -> float:
    """Mean of d^3 of a truncated lognormal distribution [m3].

    E[d^3] = D^3 exp(9 s^2 / 2) [Phi(b - 3 s) - Phi(a - 3 s)] / [Phi(b) - Phi(a)]
    D median [m], s sigma_log [1], a = ln(low / D) / s, b = ln(high / D) / s, Phi the normal distribution
    """
    s = size.sigma_log
    if s == 0.0:
        return size.median**3
    a, b = log(size.low / size.median) / s, log(size.high / size.median) / s
    normal = scipy.special.ndtr
    share = normal(b) - normal(a)
    if share <= 0.0:
        return size.median**3
    return size.median**3 * exp(4.5 * s * s) * float(normal(b - 3.0 * s) - normal(a - 3.0 * s)) / float(share)


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


def spheres_of_clump(clump: Clump) -> tuple[Sphere, ...]:
    """Spheres of a template; a shipped one has n equal touching spheres and the volume of one of diameter d.

    n (2 r)^3 = 1, so r = n^(-1/3) / 2; neighbours are 2 r apart.
    """
    if clump.template is None:
        return tuple((sphere.offset, sphere.radius) for sphere in clump.spheres)
    corners = np.array(CORNERS[clump.template])
    radius = 0.5 * len(corners) ** (-1.0 / 3.0)
    stretch = 2.0 * radius / float(np.linalg.norm(corners[0] - corners[1]))
    return tuple(((x, y, z), radius) for x, y, z in (corners * stretch).tolist())


def bounding_radius_ratio(grains: Grains) -> float:
    """Bounding radius of a grain over its nominal diameter [1]."""
    return union_body(spheres_of_clump(grains.clump)).reach if grains.clump else SPHERE_REACH


@lru_cache(maxsize=MOST_BODIES)
def union_body(spheres: tuple[Sphere, ...]) -> Body:
    """Volume, centre and inertia of a union of spheres, by counting cells with their centre in any sphere.

    I = sum over cells of h^3 [(x.x) 1 - x x^T] + V h^2 / 6, x from the centre of mass, h the cell size;
    the last term is the moment of the cells themselves.
    """
    centres = np.array([offset for offset, _ in spheres])
    radius = np.array([r for _, r in spheres])
    low, high = (centres - radius[:, None]).min(axis=0), (centres + radius[:, None]).max(axis=0)
    cell = float((high - low).max()) / VOXELS_ACROSS
    points = cell_centres_in_spheres(centres, radius, low, high, cell)
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


def cell_centres_in_spheres(
    centres: Floats, radius: Floats, low: Floats, high: Floats, cell: float
) -> Floats:
    """Centres of the cells inside the union, [cells, 3]; cells lie evenly about the middle of the box."""
    middle, counts = 0.5 * (low + high), np.ceil((high - low) / cell).astype(int)
    x, y, z = (middle[k] + (np.arange(n) - 0.5 * (n - 1)) * cell for k, n in enumerate(counts))
    inside = np.zeros(tuple(counts), dtype=bool)
    for centre, r in zip(centres, radius, strict=True):
        ends = ((at - r - cell, at + r + cell) for at in centre)
        near = tuple(slice(*np.searchsorted(*pair)) for pair in zip((x, y, z), ends, strict=True))
        a, b, c = (axis[part] - at for axis, part, at in zip((x, y, z), near, centre, strict=True))
        inside[near] |= a[:, None, None] ** 2 + b[:, None] ** 2 + c**2 <= r * r
    i, j, k = np.nonzero(inside)
    return np.column_stack([x[i], y[j], z[k]])
