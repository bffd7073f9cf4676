"""Where grains start: every fill law gives the bodies of one replica in order of release."""

from dataclasses import dataclass
from math import cos, pi, sin, sqrt

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.scene.pour import pour_layers
from taichi_erosion.scene.schema import Scene
from taichi_erosion.scene.schema_field import Vector, unit_vector
from taichi_erosion.scene.schema_grains import Lattice, Layers, Positions, Pour, Rain
from taichi_erosion.scene.schema_wind import Wind
from taichi_erosion.scene.sizes import nominal_diameter, sample_diameters
from taichi_erosion.scene.streams import stream


@dataclass(frozen=True)
class Start:
    """Bodies of one replica: a body is a spherical grain or a clump."""

    position: Floats  # [n, 3] m, centre of mass
    velocity: Floats  # [n, 3] m s-1
    spin: Floats  # [n, 3] rad s-1
    diameter: Floats  # [n] m, nominal
    release_time: Floats  # [n] s, never decreasing


def start_grains(scene: Scene, seed: int, reach: float) -> Start:
    """Bodies of one replica; `reach` is the bounding radius of a body over its diameter [1]."""
    if isinstance(scene.fill, Positions):
        return listed(scene, scene.fill)
    diameter = sample_diameters(scene.grains.size, scene.grains.count, stream(seed, "diameters"))
    if isinstance(scene.fill, Pour):
        return poured(scene, scene.fill, seed, diameter, reach)
    places = stream(seed, "places")
    fill = scene.fill
    position = net(scene, fill, len(diameter), places)
    speed = fill.speed_sd * sqrt(scene.gravity.magnitude * nominal_diameter(scene.grains.size))
    velocity = speed * stream(seed, "velocities").standard_normal(position.shape)
    return Start(position, velocity, np.zeros_like(position), diameter, np.zeros(len(diameter)))


def net(scene: Scene, fill: Rain | Lattice | Layers, count: int, places: np.random.Generator) -> Floats:
    """Centres on a jittered net, [count, 3] m."""
    if isinstance(fill, Rain):
        return rain(fill, count, places)
    if isinstance(fill, Lattice):
        return lattice(fill, count, places)
    assert scene.wind is not None
    return patch_layers(scene.wind, fill, count, places)


def patch_layers(wind: Wind, fill: Layers, count: int, places: np.random.Generator) -> Floats:
    """Rectangular nets over a periodic patch, each shifted at random, lowest layer first, [count, 3] m."""
    along, across = layer_places(wind, fill)
    x, y = np.meshgrid(np.arange(along), np.arange(across), indexing="ij")
    flat = np.column_stack([x.ravel() * wind.length / along, y.ravel() * wind.width / across])
    layers = []
    for layer in range(-(-count // len(flat))):
        points = flat + places.uniform(0.0, fill.pitch, 2)
        points = places.permutation(points % (wind.length, wind.width))
        height = np.full((len(points), 1), fill.first_height + layer * fill.pitch)
        layers.append(np.hstack([points, height]))
    position = np.concatenate(layers)[:count]
    return position + fill.jitter * places.uniform(-1.0, 1.0, position.shape)


def layer_places(wind: Wind, fill: Layers) -> tuple[int, int]:
    """Places of a layer downwind and across."""
    return int(wind.length / fill.pitch), int(wind.width / fill.pitch)


def listed(scene: Scene, fill: Positions) -> Start:
    """Grains placed one by one."""
    nominal = nominal_diameter(scene.grains.size)
    return Start(
        position=np.array([grain.position for grain in fill.grains]),
        velocity=np.array([grain.velocity for grain in fill.grains]),
        spin=np.array([grain.spin for grain in fill.grains]),
        diameter=np.array([grain.diameter or nominal for grain in fill.grains]),
        release_time=np.zeros(len(fill.grains)),
    )


def poured(scene: Scene, fill: Pour, seed: int, diameter: Floats, reach: float) -> Start:
    """Grains that pass a horizontal disc downwards."""
    layers = pour_layers(fill, reach * diameter, scene.gravity.magnitude, stream(seed, "places"))
    position = np.column_stack([layers.place, np.zeros(len(diameter))]) + np.array(fill.centre)
    velocity = np.tile((0.0, 0.0, -fill.speed), (len(diameter), 1))
    return Start(position, velocity, np.zeros_like(velocity), diameter, layers.release_time)


def rain(fill: Rain, count: int, places: np.random.Generator) -> Floats:
    """Centres of loose random layers, lowest layer first, [count, 3] m."""
    layers: list[Floats] = []
    found = 0
    while found < count:
        height = fill.first_height + len(layers) * fill.pitch
        layer = net_layer(fill, places)
        lift = height + fill.jitter * places.uniform(-1.0, 1.0, len(layer))
        layers.append(np.column_stack([layer, lift]))
        found += len(layer)
    return np.concatenate(layers)[:count] + np.array(fill.axis_point)


def net_layer(fill: Rain, places: np.random.Generator) -> Floats:
    """Points of a square net, jittered, shifted and turned, inside the radius, in random order, [n, 2] m."""
    angle, shift = places.uniform(0.0, 0.5 * pi), places.uniform(0.0, fill.pitch, 2)
    reach = int(fill.radius / fill.pitch * sqrt(2.0)) + 2
    line = np.arange(-reach, reach + 1) * fill.pitch
    net = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2) + shift
    net += fill.jitter * places.uniform(-1.0, 1.0, net.shape)
    points = net @ np.array([[cos(angle), sin(angle)], [-sin(angle), cos(angle)]])
    return places.permutation(points[np.hypot(points[:, 0], points[:, 1]) <= fill.radius])


def lattice(fill: Lattice, count: int, places: np.random.Generator) -> Floats:
    """The lowest `count` jittered points of a cubic net inside a cylinder, [count, 3] m."""
    points = lattice_points(fill)
    points = points[np.argsort(points[:, 2], kind="stable")][:count]
    return points + fill.jitter * places.uniform(-1.0, 1.0, points.shape)


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
    if isinstance(fill, Lattice):
        return fill.centre[2] + box_of(fill)[2] + reach_largest
    if isinstance(fill, Layers):
        assert scene.wind is not None
        along, across = layer_places(scene.wind, fill)
        return fill.first_height + (scene.grains.count / (along * across) + 1.0) * fill.pitch + reach_largest
    # a layer holds at least half of its mean number, so twice the mean number of layers is an upper bound
    layers = 2.0 * scene.grains.count * fill.pitch**2 / (pi * fill.radius**2) + 2.0
    return fill.axis_point[2] + fill.first_height + layers * fill.pitch + reach_largest
