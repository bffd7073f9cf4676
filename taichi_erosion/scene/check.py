"""Whether the sections of a scene fit together; each problem is one line that begins with a dotted path."""

from collections.abc import Callable, Collection, Iterator, Mapping
from math import isfinite

import numpy as np
import scipy

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene.check_wind import layer_checks, wind_checks
from taichi_erosion.scene.clump import body_of
from taichi_erosion.scene.contacts import contact_of, young_effective
from taichi_erosion.scene.fill import lattice_points
from taichi_erosion.scene.limits import (
    expected_speed,
    impact_overlap,
    refuse_unsafe_step,
    smallest_mass,
    smallest_radius,
    time_step,
)
from taichi_erosion.scene.schema import Scene
from taichi_erosion.scene.schema_geometry import Mesh, Plane
from taichi_erosion.scene.schema_grains import Lattice, Layers, Positions, Pour
from taichi_erosion.scene.sizes import nominal_diameter, size_range
from taichi_erosion.scene.walls import mesh_triangles, outward

MOST_SPHERES = 20_000_000  # in all replicas together, about 20 GB of state
MOST_STEPS = 1e10  # a stage longer than this would take weeks
SPHERE_REACH = 0.5  # radius of a sphere over its diameter [1]
LARGEST_RATIO = 20.0  # largest over smallest grain; beyond it the neighbour search drowns [1]

Known = Mapping[str, Collection[str]]


def cross_checks(scene: Scene, effects: Known | None, observables: Collection[str] | None) -> Iterator[str]:
    """Problems of a scene whose entries are right one by one."""
    names = [*name_checks(scene), *effect_checks(scene, effects), *observable_checks(scene, observables)]
    if names:
        yield from names
        return
    for check in (check_sizes, check_memory, check_fill, check_meshes, check_numbers):
        lines = list(told(check, scene))
        yield from lines
        if lines:
            return


def told(check: Callable[[Scene], Iterator[str]], scene: Scene) -> Iterator[str]:
    """Problems of one check, also where a value cannot even be computed."""
    try:
        yield from check(scene)
    except BadInput as error:
        yield str(error)
    except (OverflowError, ZeroDivisionError, FloatingPointError):
        yield "the file: numbers too extreme to compute a time step; check the units of sizes and materials"


def name_checks(scene: Scene) -> Iterator[str]:
    """Materials, contacts, surfaces and stages that are named but not there."""
    used = {"grains.material": scene.grains.material}
    used |= {f"geometry.{name}.material": wall.material for name, wall in scene.geometry.items()}
    known = ", ".join(scene.materials)
    missing = [
        f"{path} = '{name}' is not among [materials]: {known}"
        for path, name in used.items()
        if name not in scene.materials
    ]
    if missing:
        yield from missing
        return
    yield from contact_checks(scene, set(used.values()))
    yield from softening_checks(scene)
    yield from surface_checks(scene)
    yield from stage_checks(scene)
    yield from wind_checks(scene)


def contact_checks(scene: Scene, used: set[str]) -> Iterator[str]:
    """Every material meets grains: its contact with them must be stated, once."""
    grain = scene.grains.material
    for name in sorted(used):
        if contact_of(scene, grain, name) is None:
            yield f"contact.{grain}-{name} is missing"
    for pair, contact in scene.contact.items():
        a, b = pair.split("-")
        if a != b and f"{b}-{a}" in scene.contact and a < b:
            yield f"contact.{pair} and contact.{b}-{a} name the same pair"
        yield from (
            f"contact.{pair}: '{name}' is not among [materials]" for name in {a, b} - set(scene.materials)
        )
        if contact.surface_energy > 0.0 and scene.laws.normal == "hertz":
            energy = contact.surface_energy
            yield f"contact.{pair}.surface_energy = {energy:g} acts only with laws.normal = 'jkr'"


def softening_checks(scene: Scene) -> Iterator[str]:
    """One scaling rule for a whole scene."""
    rules = {name: m.softening.rule for name, m in scene.materials.items() if m.softening is not None}
    if len(set(rules.values())) > 1:
        stated = ", ".join(f"{name} '{rule}'" for name, rule in rules.items())
        yield f"materials: all softened materials must name the same rule, not {stated}"


def surface_checks(scene: Scene) -> Iterator[str]:
    """Surfaces that stages order about must exist at that time."""
    standing = set(scene.geometry)
    for place, stage in enumerate(scene.stages):
        for name in stage.remove:
            if name not in standing:
                yield f"stages.{place}.remove: '{name}' is not standing: {', '.join(sorted(standing))}"
        standing -= set(stage.remove)
        for name in stage.move:
            if name not in standing:
                yield f"stages.{place}.move.{name} is not standing: {', '.join(sorted(standing))}"
    for name, measure in scene.measure.items():
        if measure.plate is not None and measure.plate not in scene.geometry:
            yield f"measure.{name}.plate = '{measure.plate}' is not among [geometry]"


def stage_checks(scene: Scene) -> Iterator[str]:
    """Stage names are unique, and measures refer to them."""
    names = [stage.name for stage in scene.stages]
    for place, name in enumerate(names):
        if name in names[:place]:
            yield f"stages.{place}.name = '{name}' is taken by an earlier stage"
    for name, measure in scene.measure.items():
        if measure.stage is not None and measure.stage not in names:
            yield f"measure.{name}.stage = '{measure.stage}' is not among the stages: {', '.join(names)}"


def effect_checks(scene: Scene, known: Known | None) -> Iterator[str]:
    """Effects and their parameters must be in the library."""
    for name, values in scene.effects.items():
        yield from (
            f"effects.{name}.{key} must be a finite number" for key, v in values.items() if not isfinite(v)
        )
        if known is None:
            continue
        if name not in known:
            yield f"effects.{name} is unknown; known effects: {', '.join(sorted(known)) or 'none'}"
            continue
        for key in values:
            if key not in known[name]:
                yield f"effects.{name}.{key} is unknown; allowed: {', '.join(known[name])}"


def observable_checks(scene: Scene, known: Collection[str] | None) -> Iterator[str]:
    """Observables must be ones that the program can measure."""
    for name in scene.measure if known is not None else ():
        if name not in (known or ()):
            yield f"measure.{name} is unknown; known observables: {', '.join(sorted(known or ()))}"


def check_sizes(scene: Scene) -> Iterator[str]:
    """Sizes that one neighbour search can serve."""
    low, high = size_range(scene.grains.size)
    if high > LARGEST_RATIO * low:
        ratio = f"the largest may be {LARGEST_RATIO:g} times the smallest"
        yield f"grains.size: diameters from {low:g} to {high:g} m; {ratio}"


def check_memory(scene: Scene) -> Iterator[str]:
    """All replicas together must fit into memory."""
    clump = scene.grains.clump
    spheres = scene.grains.count * (len(body_of(clump).radius) if clump else 1) * scene.run.replicas
    if spheres > MOST_SPHERES:
        replicas = scene.run.replicas
        yield f"run.replicas = {replicas}: {spheres} spheres in all replicas; at most {MOST_SPHERES} fit"


def reach_over_diameter(scene: Scene) -> float:
    """Bounding radius of a grain over its nominal diameter [1]."""
    return body_of(scene.grains.clump).reach if scene.grains.clump else SPHERE_REACH


def check_fill(scene: Scene) -> Iterator[str]:
    """Grains start apart and find room."""
    fill, reach = scene.fill, reach_over_diameter(scene) * size_range(scene.grains.size)[1]
    if isinstance(fill, Positions):
        yield from listed_checks(scene, fill)
        return
    if isinstance(fill, Layers):
        yield from layer_checks(scene, fill, reach)
        return
    if fill.radius < reach:
        yield f"fill.radius = {fill.radius:g} m is smaller than a grain's reach of {reach:g} m"
        return
    if isinstance(fill, Pour):
        if fill.speed == 0.0 and scene.gravity.magnitude == 0.0:
            yield "fill.speed = 0.0 without gravity: poured grains would never fall"
        return
    if fill.pitch - 2.0 * fill.jitter < 2.0 * reach:
        yield (
            f"fill.pitch = {fill.pitch:g} m less twice the jitter is smaller than the largest grain, "
            f"{2.0 * reach:g} m: grains would start inside each other"
        )
    elif isinstance(fill, Lattice):
        yield from lattice_checks(scene, fill)


def lattice_checks(scene: Scene, fill: Lattice) -> Iterator[str]:
    """A lattice has a limited number of places."""
    cells = (2.0 * fill.radius + fill.length) ** 3 / fill.pitch**3
    places = len(lattice_points(fill)) if cells < MOST_SPHERES else MOST_SPHERES
    if places < scene.grains.count:
        yield f"grains.count = {scene.grains.count}: the fill has {places} places"


def listed_checks(scene: Scene, fill: Positions) -> Iterator[str]:
    """Explicitly placed grains are as many as stated, and apart from each other and from planes."""
    if len(fill.grains) != scene.grains.count:
        yield f"grains.count = {scene.grains.count}, but fill.grains lists {len(fill.grains)}"
        return
    nominal = nominal_diameter(scene.grains.size)
    centres = np.array([grain.position for grain in fill.grains])
    radius = reach_over_diameter(scene) * np.array([grain.diameter or nominal for grain in fill.grains])
    for i, j in sorted(scipy.spatial.KDTree(centres).query_pairs(2.0 * float(radius.max()))):
        overlap = radius[i] + radius[j] - float(np.linalg.norm(centres[i] - centres[j]))
        if overlap > scene.run.overlap_limit * min(radius[i], radius[j]):
            yield f"fill.grains.{j} overlaps fill.grains.{i} by {overlap:.3g} m"
    planes = {name: wall for name, wall in scene.geometry.items() if isinstance(wall, Plane)}
    for i, grain in enumerate(fill.grains if scene.grains.clump is None else ()):
        for name, wall in planes.items():
            overlap = radius[i] - outward(grain.position, wall)
            if overlap > scene.run.overlap_limit * radius[i]:
                yield f"fill.grains.{i} overlaps geometry.{name} by {overlap:.3g} m"


def check_meshes(scene: Scene) -> Iterator[str]:
    """Mesh files can be read."""
    for name, wall in scene.geometry.items():
        if isinstance(wall, Mesh):
            mesh_triangles(scene, name, wall)
    yield from ()


def check_numbers(scene: Scene) -> Iterator[str]:
    """Time step and stiffness are sane."""
    refuse_unsafe_step(scene)
    steps = sum(stage.duration_max for stage in scene.stages) / time_step(scene)
    if steps > MOST_STEPS:
        yield f"stages: {steps:.2g} steps of {time_step(scene):.2g} s; soften grains or shorten stages"
    material, radius = scene.materials[scene.grains.material], smallest_radius(scene)
    young, speed = young_effective(material, material), expected_speed(scene)
    overlap = impact_overlap(0.5 * smallest_mass(scene), 0.5 * radius, young, speed) / radius
    if overlap > scene.run.overlap_limit:
        yield (
            f"materials.{scene.grains.material}: too soft: an impact at {speed:.3g} m s-1 would overlap by "
            f"{overlap:.2g} radii; run.overlap_limit is {scene.run.overlap_limit:g}"
        )
