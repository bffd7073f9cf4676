"""Initial bodies of one replica in order of release: random streams, and one function per fill law."""

from dataclasses import dataclass
from hashlib import sha256
from math import cos, pi, sin, sqrt

import numpy as np
import scipy

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats, Integers
from taichi_erosion.scene.preparation.bed import bed_grains, saved_bed
from taichi_erosion.scene.preparation.sizes import kind_counts, nominal_diameter, sample_diameters
from taichi_erosion.scene.preparation.walls import distance_to_wall
from taichi_erosion.scene.schema.fields import Vector, unit_vector
from taichi_erosion.scene.schema.grains import Bed, Lattice, Layers, Positions, Pour, Rain
from taichi_erosion.scene.schema.scene import Scene

CLEARANCE = 1.05  # distance of two layers over the sum of their largest radii [1]
MOST_LAYERS = 200  # of rain in which none of the points is free for a grain [1]
TRIES = 400  # random places tried for a grain before its layer is closed [1]


def stream(seed: int, purpose: str) -> np.random.Generator:
    """Independent random stream of a seed and a purpose, from a counter-based generator.

    Reference: Salmon et al. (2011), SC '11, article 16 (Philox).
    """
    digest = sha256(f"{seed}:{purpose}".encode()).digest()
    return np.random.Generator(np.random.Philox(key=np.frombuffer(digest[:16], dtype=np.uint64)))


def pour_layers(
    fill: Pour, radius: Floats, gravity: float, random: np.random.Generator
) -> tuple[Floats, Floats]:
    """Random places from the centre of the disc [n, 2] m, and release times [n] s, of bounding radii [m].

    A layer is released at once, the next one when this one has fallen clear of the plane, by the distance
    v t + g t^2 / 2. A rate makes layers as thin as it can keep them, so that the flow is steady; where one
    grain a layer is still too fast, layers wait.
    """
    distance = 2.0 * CLEARANCE * float(radius.max())
    clear = 2.0 * distance / (fill.speed + sqrt(fill.speed * fill.speed + 2.0 * gravity * distance))
    most = max(1, round(fill.rate * clear)) if fill.rate else len(radius)
    place = np.empty((len(radius), 2))
    release = np.empty(len(radius))
    first, time = 0, 0.0
    while first < len(radius):
        layer = random_layer(fill, radius[first : first + most], random)
        last = first + len(layer)
        place[first:last], release[first:last] = layer, time
        time += max(clear, len(layer) / fill.rate if fill.rate else 0.0)
        first = last
    return place, release


def random_layer(fill: Pour, radius: Floats, random: np.random.Generator) -> Floats:
    """Random sequential addition of the next grains up to the wanted coverage, [n, 2] m."""
    allowed = np.searchsorted(np.cumsum(radius**2), fill.coverage * fill.radius**2, side="right")
    wanted = max(1, min(int(allowed), len(radius)))
    found = np.empty((wanted, 2))
    for k in range(wanted):
        place = free_place(fill.radius - radius[k], found[:k], radius[:k] + radius[k], random)
        if place is None:
            return found[:k]
        found[k] = place
    return found


def free_place(bound: float, others: Floats, distance: Floats, random: np.random.Generator) -> Floats | None:
    """A place in a disc of radius `bound`, farther than `distance` from the others, or None."""
    for _ in range(TRIES):
        angle, r = random.uniform(0.0, 2.0 * pi), bound * sqrt(random.uniform())
        place = np.array([r * np.cos(angle), r * np.sin(angle)])
        if np.all(np.sum((others - place) ** 2, axis=1) >= distance**2):
            return place
    return None


@dataclass(frozen=True)
class InitialBodies:
    """Bodies of one replica: a body is a spherical grain or a clump."""

    position: Floats  # [n, 3] m, centre of mass
    velocity: Floats  # [n, 3] m s-1
    spin: Floats  # [n, 3] rad s-1
    kind: Integers  # [n] place in the scene's `Grains.parts`
    diameter: Floats  # [n] m, nominal
    release_time: Floats  # [n] s, never decreasing


def initial_bodies(scene: Scene, seed: int, reach: float) -> InitialBodies:
    """Bodies of one replica; `reach` is the bounding radius of a body over its diameter [1]."""
    fill, gravity, nominal = scene.fill, scene.gravity.magnitude, nominal_diameter(scene.grains)
    if isinstance(fill, Positions):
        return InitialBodies(
            position=np.array([grain.position for grain in fill.grains]),
            velocity=np.array([grain.velocity for grain in fill.grains]),
            spin=np.array([grain.spin for grain in fill.grains]),
            kind=np.array(
                [
                    list(scene.grains.parts).index(grain.kind or scene.grains.material or "")
                    for grain in fill.grains
                ]
            ),
            diameter=listed_diameters(scene, fill),
            release_time=np.zeros(len(fill.grains)),
        )
    if isinstance(fill, Bed):
        rows = bed_grains(saved_bed(scene, fill, seed))
        motion = rows["position"], rows["velocity"], rows["spin"]
        return InitialBodies(
            *motion, rows["kind"].astype(np.int32), 2.0 * rows["radius"], 0.0 * rows["radius"]
        )
    count, random = scene.grains.count, stream(seed, "places")
    kind, diameter = sample_kinds(scene, stream(seed, "diameters"), stream(seed, "kinds"))
    release = np.zeros(count)
    if isinstance(fill, Pour):
        place, release = pour_layers(fill, reach * diameter, gravity, random)
        position = np.column_stack([place, np.zeros(count)]) + np.array(fill.centre)
        velocity = np.tile((0.0, 0.0, -fill.speed), (count, 1))
    else:
        position = net_places(scene, fill, reach * diameter, random)
        speed = fill.speed_sd * sqrt(gravity * nominal)
        velocity = speed * stream(seed, "velocities").standard_normal(position.shape)
    return InitialBodies(position, velocity, np.zeros_like(position), kind, diameter, release)


def listed_diameters(scene: Scene, fill: Positions) -> Floats:
    """Diameters of explicitly placed grains [n] m."""
    parts = scene.grains.parts
    nominal = {name: nominal_diameter(part.size) for name, part in parts.items()}
    return np.array([g.diameter or nominal[g.kind or scene.grains.material or ""] for g in fill.grains])


def sample_kinds(
    scene: Scene, sizes: np.random.Generator, order: np.random.Generator
) -> tuple[Integers, Floats]:
    """Kinds and diameters [m] of all grains; several kinds in random order."""
    parts, counts = scene.grains.parts, kind_counts(scene)
    diameter = np.concatenate([sample_diameters(parts[name].size, n, sizes) for name, n in counts.items()])
    kind = np.repeat(np.arange(len(parts), dtype=np.int32), list(counts.values()))
    if len(parts) == 1:
        return kind, diameter
    places = order.permutation(len(kind))
    return kind[places], diameter[places]


def net_places(
    scene: Scene, fill: Rain | Lattice | Layers, radius: Floats, random: np.random.Generator
) -> Floats:
    """Jittered places of a net for bodies of bounding radii [m], [count, 3] m."""
    if isinstance(fill, Rain):
        return first_free(scene, fill, radius, random)
    if isinstance(fill, Lattice):
        return lattice(fill, scene.grains.count, random)
    assert scene.patch_size is not None
    return patch_layers(scene.patch_size, fill, scene.grains.count, random)


def patch_layers(size: tuple[float, float], fill: Layers, count: int, random: np.random.Generator) -> Floats:
    """Rectangular nets over a periodic patch, each shifted at random, lowest layer first, [count, 3] m."""
    along, across = places_per_layer(size, fill)
    x, y = np.meshgrid(np.arange(along), np.arange(across), indexing="ij")
    flat = np.column_stack([x.ravel() * size[0] / along, y.ravel() * size[1] / across])
    layers = []
    for layer in range(-(-count // len(flat))):
        points = flat + random.uniform(0.0, fill.pitch, 2)
        points = random.permutation(points % size)
        height = np.full((len(points), 1), fill.first_height + layer * fill.pitch)
        layers.append(np.hstack([points, height]))
    position = np.concatenate(layers)[:count]
    return position + fill.jitter * random.uniform(-1.0, 1.0, position.shape)


def places_per_layer(size: tuple[float, float], fill: Layers) -> tuple[int, int]:
    """Places of a layer along x and y in a period of a size [m]."""
    return int(size[0] / fill.pitch), int(size[1] / fill.pitch)


def first_free(scene: Scene, fill: Rain, radius: Floats, random: np.random.Generator) -> Floats:
    """Places of bodies, each at the first point of the layers that is clear of walls and of earlier bodies.

    Where the net is wider than all these are its points in turn. Raises BadInput where one finds none.
    """
    points, free, place = np.empty((0, 3)), np.empty(0), np.empty((len(radius), 3))
    number, last, first, largest = 0, 0, 0, radius.max()
    meets = radius + largest > fill.pitch - 2.0 * fill.jitter
    for k, r in enumerate(radius):
        while not (fits := free[first:] >= r).any():
            if number - last > MOST_LAYERS:
                raise BadInput(f"fill: a grain with a reach of {r:g} m finds no place between walls")
            layer, number = net_layer(fill, number, random), number + 1
            lowest = layer[:, 2].min(initial=np.inf) - 2.0 * largest
            near = np.flatnonzero(meets[:k] & (place[:k, 2] > lowest))
            gaps = scipy.spatial.distance.cdist(layer, place[near]) - radius[near]
            walls = [distance_to_wall(scene, name, layer) for name in scene.geometry]
            points = np.concatenate([points, layer])
            free = np.append(free, np.min(np.column_stack([gaps, *walls]), axis=1, initial=np.inf))
        place[k], free[first + fits.argmax()] = points[first + fits.argmax()], -np.inf
        if meets[k]:
            free = np.minimum(free, np.linalg.norm(points - place[k], axis=1) - r)
        last, first = number, first + int((free[first:] >= radius.min()).argmax())
    return place


def net_layer(fill: Rain, number: int, random: np.random.Generator) -> Floats:
    """Points of a square net, jittered, shifted and turned, inside the radius, in random order, [n, 3] m."""
    angle, shift = random.uniform(0.0, 0.5 * pi), random.uniform(0.0, fill.pitch, 2)
    reach = int(fill.radius / fill.pitch * sqrt(2.0)) + 2
    line = np.arange(-reach, reach + 1) * fill.pitch
    net = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2) + shift
    net += fill.jitter * random.uniform(-1.0, 1.0, net.shape)
    points = net @ np.array([[cos(angle), sin(angle)], [-sin(angle), cos(angle)]])
    points = random.permutation(points[np.hypot(points[:, 0], points[:, 1]) <= fill.radius])
    lift = fill.first_height + number * fill.pitch + fill.jitter * random.uniform(-1.0, 1.0, len(points))
    return np.column_stack([points, lift]) + np.array(fill.axis_point)


def lattice(fill: Lattice, count: int, random: np.random.Generator) -> Floats:
    """The lowest `count` jittered points of a cubic net inside a cylinder, [count, 3] m."""
    points = lattice_points(fill)
    points = points[np.argsort(points[:, 2], kind="stable")][:count]
    return points + fill.jitter * random.uniform(-1.0, 1.0, points.shape)


def lattice_points(fill: Lattice) -> Floats:
    """Points of the cubic net that stay inside the cylinder when jittered, [n, 3] m."""
    axis = np.array(unit_vector(fill.axis))
    margin = sqrt(3.0) * fill.jitter
    radius, half = fill.radius - margin, 0.5 * fill.length - margin
    steps = int((fill.radius + fill.length) / fill.pitch) + 1
    line = np.arange(-steps, steps + 1) * fill.pitch
    points = np.stack(
        np.meshgrid(*[line[np.abs(line) <= bound] for bound in box_of(fill)], indexing="ij"), axis=-1
    )
    points = points.reshape(-1, 3)
    along = points @ axis
    across = np.linalg.norm(points - along[:, None] * axis, axis=1)
    inside = (across <= radius) & (np.abs(along) <= half)
    return np.asarray(points[inside] + np.array(fill.centre), dtype=np.float64)


def box_of(fill: Lattice) -> Vector:
    """Half sides of the box around a cylinder [m]."""
    x, y, z = (
        abs(c) * 0.5 * fill.length + sqrt(max(1.0 - c * c, 0.0)) * fill.radius for c in unit_vector(fill.axis)
    )
    return x, y, z


def start_top(scene: Scene, reach_largest: float) -> float:
    """Highest point at which a grain can start [m]; `reach_largest` bounds the grains' radii."""
    fill = scene.fill
    if isinstance(fill, Positions):
        return max(grain.position[2] for grain in fill.grains) + reach_largest
    if isinstance(fill, Pour):
        return fill.centre[2] + reach_largest
    if isinstance(fill, Bed):
        return float(saved_bed(scene, fill, scene.run.seed)["position"][:, 2].max()) + reach_largest
    if isinstance(fill, Lattice):
        return fill.centre[2] + box_of(fill)[2] + reach_largest
    if isinstance(fill, Layers):
        assert scene.patch_size is not None
        along, across = places_per_layer(scene.patch_size, fill)
        return fill.first_height + (scene.grains.count / (along * across) + 1.0) * fill.pitch + reach_largest
    # a layer holds at least half of its mean number, so twice the mean number of layers is an upper bound
    layers = 2.0 * scene.grains.count * fill.pitch**2 / (pi * fill.radius**2) + 2.0
    return fill.axis_point[2] + fill.first_height + layers * fill.pitch + reach_largest
