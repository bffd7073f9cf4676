"""Initial bodies of one replica in order of release: random streams, and one function per fill law."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from math import cos, inf, pi, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.random import Generator

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats, Integers
from taichi_erosion.scene.checkpoint_file import Arrays, load_checkpoint
from taichi_erosion.scene.preparation import sizes
from taichi_erosion.scene.preparation.walls import bounding_box, closed_mesh, distance_to_wall, mesh_depths
from taichi_erosion.scene.schema.fields import FARTHEST, Vector, resolve, unit_vector
from taichi_erosion.scene.schema.grains import Bed, Inlet, Lattice, Layers, Positions, Pour, Rain
from taichi_erosion.scene.schema.scene import Scene

CLEARANCE = 1.05  # distance of two layers over the sum of their largest radii [1]
MOST_LAYERS = 200  # of rain in which none of the points is free for a grain [1]
ASIDE = 0.1  # of a radius that grains lie beside a line, without which they would stack in one plane [1]
AT_ONCE = 20_000  # pairs of a point and a triangle that are compared at once
TRIES = 400  # random places tried for a grain before its layer is closed [1]

Places = Iterator[tuple[Floats, float]]  # of points inside a mesh, with their depth [m]


def random_stream(seed: int, purpose: str) -> Generator:
    """Independent random stream of a seed and a purpose, from a counter-based generator.

    Reference: Salmon et al. (2011), SC '11, article 16 (Philox).
    """
    digest = sha256(f"{seed}:{purpose}".encode()).digest()
    return Generator(np.random.Philox(key=np.frombuffer(digest[:16], dtype=np.uint64)))


def pour_grains(
    scene: Scene, fill: Pour, kind: Integers, diameter: Floats, reach: float, seed: int
) -> tuple[Floats, Floats, Floats]:
    """Places [n, 3] m, velocities and release times [n] s of grains of some kinds and diameters [m].

    Every inlet gets its share of each kind that passes it.
    """
    random, gravity, kinds = random_stream(seed, "places"), scene.gravity.magnitude, list(scene.grains.parts)
    density = np.array([material.density for material in scene.grain_materials.values()])
    place, velocity, release = np.empty((len(kind), 3)), np.zeros((len(kind), 3)), np.empty(len(kind))
    owner = np.empty(len(kind), np.int32)
    inlets = list(fill.parts.items())
    for k, name in enumerate(kinds):
        shares = np.cumsum([each.share * (each.kind in (None, name)) for _, each in inlets])
        rows = np.flatnonzero(kind == k)
        owner[rows] = np.searchsorted(shares / shares[-1], (np.arange(len(rows)) + 0.5) / max(len(rows), 1))
    for number, (path, inlet) in enumerate(inlets):
        rows = np.flatnonzero(owner == number)
        if inlet.mass_rate is not None and len(rows):
            masses = density[kind[rows]] * pi / 6.0 * diameter[rows] ** 3
            inlet = inlet.model_copy(update={"rate": inlet.mass_rate / masses.mean()})
        place[rows], release[rows] = pour_grains_of_inlet(
            inlet, reach * diameter[rows], gravity, random, inlet_mesh(scene, path, inlet)
        )
        velocity[rows, 2] = -inlet.speed
    return place, velocity, release


def pour_with_inlets_open(scene: Scene, time: float, at: Sequence[float], name: str, latest: float) -> Pour:
    """Inlets that open at a time [s]: about a place [m], one grain after the other; one of the scene; or all.

    Those of the scene open once the `latest` grain [s] has fallen clear. Raises BadInput where there is none.
    """
    wide = sizes.bounding_radius_ratio(scene.grains) * sizes.size_range(scene.grains)[1]
    if len(at) not in (0, 3) or not np.all(np.abs(at) < FARTHEST):
        raise BadInput("insert: a place has coordinates x, y, z in m")
    if len(at):
        x, y, z = map(float, at)
        return Pour(law="pour", centre=(x, y, z), radius=(1.0 + ASIDE) * wide, speed=0.0, begin=time)
    parts, g = scene.fill.parts if isinstance(scene.fill, Pour) else {}, scene.gravity.magnitude
    clear = [fall_time(each, wide, g, inlet_mesh(scene, path, each)) for path, each in parts.items()]
    begin = max([time, *(latest + wait for wait in clear)])
    later = {k.rpartition(".")[2]: each.model_copy(update={"begin": begin}) for k, each in parts.items()}
    if not later or (name or next(iter(later))) not in later:
        names = ", ".join(later) or "none, so name a place: insert 1 at 0 0 0.1"
        raise BadInput(f"no inlet '{name or 'fill'}'; there are {names}")
    return Pour.model_construct(law="pour", inlets={name: later[name]} if name else later)


def pour_grains_of_inlet(
    inlet: Inlet, radius: Floats, gravity: float, random: Generator, mesh: Floats
) -> tuple[Floats, Floats]:
    """Random places [n, 3] m and release times [n] s of grains of bounding radii [m] at one inlet.

    A layer is released at once, the next one when this one has fallen clear of it. A rate makes layers as
    thin as it can keep them, so that the flow is steady; where one grain a layer is still too fast, layers
    wait. Raises BadInput where a grain finds no place.
    """
    clear = fall_time(inlet, float(radius.max(initial=0.0)), gravity, mesh)
    most = max(1, round(inlet.rate * clear)) if inlet.rate else len(radius)
    place = np.empty((len(radius), 3))
    release, inside = np.empty(len(radius)), random_points_in_mesh(mesh, random)
    first, time = 0, inlet.begin
    while first < len(radius):
        layer = random_layer(inlet, radius[first : first + most], random, mesh_volume(mesh), inside)
        if not len(layer):
            raise BadInput(f"fill: a grain with a reach of {radius[first]:g} m finds no place in the mesh")
        last = first + len(layer)
        place[first:last], release[first:last] = layer, time
        time += max(clear, len(layer) / inlet.rate if inlet.rate else 0.0)
        first = last
    return place + np.array(inlet.centre or inlet.middle), release


def inlet_mesh(scene: Scene, path: str, inlet: Inlet) -> Floats:
    """Triangles around an inlet [t, 3, 3] m, none of a flat one."""
    return closed_mesh(scene, f"{path}.mesh", inlet.mesh) if inlet.mesh else np.zeros((0, 3, 3))


def fall_time(inlet: Inlet, largest: float, gravity: float, mesh: Floats) -> float:
    """Time in which a layer falls clear of the next [s]:  v t + g t^2 / 2  is the distance of two layers."""
    distance = 2.0 * CLEARANCE * largest + (float(np.ptp(mesh[..., 2])) if len(mesh) else 0.0)
    return 2.0 * distance / (inlet.speed + sqrt(inlet.speed * inlet.speed + 2.0 * gravity * distance) or inf)


def random_layer(inlet: Inlet, radius: Floats, draw: Generator, cubes: float, inside: Places) -> Floats:
    """Random sequential addition of the next grains up to the wanted coverage, [n, 3] m from the centre."""
    square = inlet.radius**2 if inlet.radius else inlet.area(2.0 * radius.max()) / pi
    shares, whole = (radius**3, cubes / 8.0) if inlet.mesh else (radius**2, square)
    allowed = np.searchsorted(np.cumsum(shares), inlet.coverage * whole, side="right")
    count = max(1, min(int(allowed), len(radius)))
    points = np.zeros((count, 3))
    for k in range(count):
        place = random_free_place(inlet, radius[k], points[:k], radius[:k] + radius[k], draw, inside)
        if place is None:
            return points[:k]
        points[k] = place
    return points


def mesh_volume(mesh: Floats) -> float:
    """Volume inside a closed mesh over that of a grain of diameter 1 m [1]."""
    return float(abs(np.linalg.det(mesh).sum()) / pi)


def random_points_in_mesh(mesh: Floats, random: Generator) -> Places:
    """Random points inside a closed mesh, each with its depth [m], without end."""
    low, high = bounding_box(mesh)
    while True:
        points = random.uniform(low, high, (AT_ONCE // len(mesh) + 1, 3))
        deep = mesh_depths(mesh, points)
        yield from zip(points[deep > 0.0], deep[deep > 0.0], strict=True)


def random_free_place(
    inlet: Inlet, radius: float, others: Floats, distance: Floats, random: Generator, inside: Places
) -> Floats | None:
    """A place in the shape for a grain, farther than `distance` from the others, or None."""
    for _ in range(TRIES):
        if inlet.radius:
            angle, r = random.uniform(0.0, 2.0 * pi), (inlet.radius - radius) * sqrt(random.uniform())
            place = np.array([r * np.cos(angle), r * np.sin(angle), 0.0])
        elif inlet.size:
            place = np.append((np.array(inlet.size) - 2.0 * radius) * (random.uniform(size=2) - 0.5), 0.0)
        elif inlet.mesh:
            place, depth = next(inside)
            if depth < radius:
                continue
        else:
            along = 2.0 * np.subtract(inlet.middle, inlet.centre or inlet.middle)
            across = np.array([-along[1], along[0], 0.0]) / np.linalg.norm(along)
            place = along * random.uniform() + radius * ASIDE * random.uniform(-1.0, 1.0) * across
        offset = others - place
        if not (np.einsum("ij,ij->i", offset, offset) < distance**2).any():
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
    fill, gravity, nominal = scene.fill, scene.gravity.magnitude, sizes.nominal_diameter(scene.grains)
    if isinstance(fill, Positions):
        kinds = [grain.kind or scene.grains.material or "" for grain in fill.grains]
        return InitialBodies(
            position=np.array([grain.position for grain in fill.grains]),
            velocity=np.array([grain.velocity for grain in fill.grains]),
            spin=np.array([grain.spin for grain in fill.grains]),
            kind=np.array([list(scene.grains.parts).index(kind) for kind in kinds]),
            diameter=placed_diameters(scene, fill),
            release_time=np.zeros(len(fill.grains)),
        )
    if isinstance(fill, Bed):
        bed, names = saved_bed(scene, fill, seed), ("position", "velocity", "spin", "radius", "kind")
        columns = (bed[name][np.argsort(bed["ident"])].astype(np.float64) for name in names)
        place, velocity, spin, radius, kind = columns
        return InitialBodies(place, velocity, spin, kind.astype(np.int32), 2.0 * radius, 0.0 * radius)
    count, random = scene.grains.count, random_stream(seed, "places")
    kind, diameter = kinds_and_sizes(scene, random_stream(seed, "diameters"), random_stream(seed, "kinds"))
    release = np.zeros(count)
    if isinstance(fill, Pour):
        position, velocity, release = pour_grains(scene, fill, kind, diameter, reach, seed)
        order = np.argsort(release, kind="stable")
        kind, diameter, release = kind[order], diameter[order], release[order]
        position, velocity = position[order], velocity[order]
    else:
        position = net_places(scene, fill, reach * diameter, random)
        speed = fill.speed_sd * sqrt(gravity * nominal)
        velocity = speed * random_stream(seed, "velocities").standard_normal(position.shape)
    return InitialBodies(position, velocity, np.zeros_like(position), kind, diameter, release)


def placed_diameters(scene: Scene, fill: Positions) -> Floats:
    """Diameters of explicitly placed grains [n] m."""
    nominal = {name: sizes.nominal_diameter(part.size) for name, part in scene.grains.parts.items()}
    return np.array([g.diameter or nominal[g.kind or scene.grains.material or ""] for g in fill.grains])


def kinds_and_sizes(scene: Scene, draw: Generator, order: Generator) -> tuple[Integers, Floats]:
    """Kinds and diameters [m] of all grains; several kinds in random order."""
    parts, counts = scene.grains.parts, sizes.grain_count_of_kinds(scene)
    diameter = np.concatenate([sizes.sample_diameters(parts[k].size, n, draw) for k, n in counts.items()])
    kind = np.repeat(np.arange(len(parts), dtype=np.int32), list(counts.values()))
    if len(parts) == 1:
        return kind, diameter
    places = order.permutation(len(kind))
    return kind[places], diameter[places]


def net_places(scene: Scene, fill: Rain | Lattice | Layers, radius: Floats, random: Generator) -> Floats:
    """Jittered places of a net for bodies of bounding radii [m], [count, 3] m."""
    if isinstance(fill, Rain):
        return first_free_layer_places(scene, fill, radius, random)
    if isinstance(fill, Lattice):  # the lowest points
        points = cubic_lattice(fill)
        points = points[np.argsort(points[:, 2], kind="stable")][: scene.grains.count]
        return points + fill.jitter * random.uniform(-1.0, 1.0, points.shape)
    assert scene.periods_xy is not None
    return grain_layers_of_patch(scene.periods_xy, fill, scene.grains.count, random)


def grain_layers_of_patch(size: tuple[float, float], fill: Layers, count: int, random: Generator) -> Floats:
    """Rectangular nets over a periodic patch, each shifted at random, lowest layer first, [count, 3] m."""
    along, across = places_per_layer(size, fill)
    x, y = np.meshgrid(np.arange(along), np.arange(across), indexing="ij")
    flat = np.column_stack([x.ravel() * size[0] / along, y.ravel() * size[1] / across])
    layers = []
    for layer in range(-(-count // len(flat))):
        points = flat + random.uniform(0.0, fill.pitch, 2)
        points = random.permutation(points % size)
        layers.append(np.hstack([points, np.full((len(points), 1), fill.first_height + layer * fill.pitch)]))
    position = np.concatenate(layers)[:count]
    return position + fill.jitter * random.uniform(-1.0, 1.0, position.shape)


def places_per_layer(size: tuple[float, float], fill: Layers) -> tuple[int, int]:
    """Places of a layer along x and y in a period of a size [m]."""
    return int(size[0] / fill.pitch), int(size[1] / fill.pitch)


def first_free_layer_places(scene: Scene, fill: Rain, radius: Floats, random: Generator) -> Floats:
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
            layer, number = random_square_net(fill, number, random), number + 1
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


def random_square_net(fill: Rain, number: int, random: Generator) -> Floats:
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


def cubic_lattice(fill: Lattice) -> Floats:
    """Points of the cubic net that stay inside the cylinder when jittered, [n, 3] m."""
    axis = np.array(unit_vector(fill.axis))
    margin = sqrt(3.0) * fill.jitter
    radius, half = fill.radius - margin, 0.5 * fill.length - margin
    steps = int((fill.radius + fill.length) / fill.pitch) + 1
    line = np.arange(-steps, steps + 1) * fill.pitch
    points = np.stack(np.meshgrid(*[line[np.abs(line) <= b] for b in half_box(fill)], indexing="ij"), axis=-1)
    points = points.reshape(-1, 3)
    along = points @ axis
    inside = (np.linalg.norm(points - along[:, None] * axis, axis=1) <= radius) & (np.abs(along) <= half)
    return np.asarray(points[inside] + np.array(fill.centre), dtype=np.float64)


def half_box(fill: Lattice) -> Vector:
    """Half sides of the box around a cylinder [m]."""
    x, y, z = (
        abs(c) * 0.5 * fill.length + sqrt(max(1.0 - c * c, 0.0)) * fill.radius for c in unit_vector(fill.axis)
    )
    return x, y, z


def highest_start(scene: Scene, reach_largest: float) -> float:
    """Highest point at which a grain can start [m]; `reach_largest` bounds the grains' radii."""
    fill = scene.fill
    if isinstance(fill, Positions):
        return max(grain.position[2] for grain in fill.grains) + reach_largest
    if isinstance(fill, Pour):
        meshes = [(each, inlet_mesh(scene, path, each)[..., 2]) for path, each in fill.parts.items()]
        return max(z.max() if each.mesh else each.middle[2] for each, z in meshes) + reach_largest
    if isinstance(fill, Bed):
        return float(saved_bed(scene, fill, scene.run.seed)["position"][:, 2].max()) + reach_largest
    if isinstance(fill, Lattice):
        return fill.centre[2] + half_box(fill)[2] + reach_largest
    if isinstance(fill, Layers):
        assert scene.periods_xy is not None
        along, across = places_per_layer(scene.periods_xy, fill)
        return fill.first_height + (scene.grains.count / (along * across) + 1.0) * fill.pitch + reach_largest
    # a layer holds at least half of its mean number, so twice the mean number of layers is an upper bound
    layers = 2.0 * scene.grains.count * fill.pitch**2 / (pi * fill.radius**2) + 2.0
    return fill.axis_point[2] + fill.first_height + layers * fill.pitch + reach_largest


@lru_cache(maxsize=1)
def read_bed_checkpoint(path: Path, _written: float) -> tuple[Arrays, dict[str, Any]]:
    """State and meta of a checkpoint, kept until the file is written again."""
    return load_checkpoint(path)


def saved_bed(scene: Scene, fill: Bed, seed: int) -> Arrays:
    """Grains and contacts of one replica of a checkpoint by rank; `kind` is a place in `Grains.parts`.

    The replica has the same place as that of the seed; fewer of them serve in turn. Raises BadInput.
    """
    path = scene.folder / fill.file
    state, meta = read_bed_checkpoint(path, path.stat().st_mtime if path.is_file() else 0.0)
    before: dict[str, Any] = meta.get("scene", {"grains": {}})
    wind, patch = before.get("wind"), before.get("domain", {}).get("period")
    patch = [wind["length"], wind["width"]] if wind else patch
    if before["grains"] != resolve(scene)["grains"] or patch != (scene.periods_xy and [*scene.periods_xy]):
        raise BadInput(f"fill.file = '{fill.file}': [grains] or periods differ from those of the checkpoint")
    if scene.grains.clump is not None:
        raise BadInput(f"fill.file = '{fill.file}': a bed consists of spheres; grains.clump must be left out")
    prefix = f"replica{(seed - scene.run.seed) % len(meta['replicas'])}_"
    bed = {name.removeprefix(prefix): values for name, values in state.items() if name.startswith(prefix)}
    kinds = list(scene.grains.parts)
    names = sorted({*kinds, *(wall["material"] for wall in before["geometry"].values())})
    places = np.array([kinds.index(name) if name in kinds else -1 for name in names])
    return bed | {"kind": places[bed["material"].astype(int)], "position": bed["origin"] + bed["shift"]}
