"""Whether a grid of air over a patch fits together; each problem is one line that begins with its path.

Whether a patch under wind fits together; each problem is one line that begins with a dotted path.

Whether the sections of a scene fit together; each problem is one line that begins with a dotted path.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from math import isfinite, log, sqrt

import numpy as np
import scipy

from taichi_erosion.core.air_setup import ClosureConstants
from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene.build.clump import body_of
from taichi_erosion.scene.build.contacts import contact_of, young_effective
from taichi_erosion.scene.build.fill import lattice_points, layer_places
from taichi_erosion.scene.build.limits import (
    expected_speed,
    impact_overlap,
    refuse_unsafe_step,
    smallest_mass,
    smallest_radius,
    time_step,
)
from taichi_erosion.scene.build.sizes import nominal_diameter, size_range
from taichi_erosion.scene.build.walls import mesh_triangles, outward
from taichi_erosion.scene.build.wind import GRAIN_ROUGHNESS, surface_height
from taichi_erosion.scene.schema.geometry import Mesh, Plane
from taichi_erosion.scene.schema.grains import Lattice, Layers, Positions, Pour
from taichi_erosion.scene.schema.scene import Scene
from taichi_erosion.scene.schema.wind import Wind

COLUMNS_LEAST = 4  # in each direction: fewer carry no wave
COURANT_MOST = 1.2  # of the fastest gust expected; the scheme is stable up to 1.7 [1]
GUST = 3.0 * 2.5  # u' that hardly any gust exceeds, over u*: three deviations near a wall [1]
OF_ONE_COLUMN = ("bed_stress", "pressure_drop")  # measures that read its mixing length or its rising air


def grid_checks(scene: Scene, wind: Wind) -> Iterator[str]:
    """Columns, closure and what drives go together."""
    if wind.columns == (1, 1):
        if wind.closure == "smagorinsky":
            yield "wind.closure = 'smagorinsky': one column has no eddies; state wind.columns"
        if wind.drive == "gradient":
            yield "wind.drive = 'gradient': one column is driven by its lid; state wind.columns"
        return
    yield from column_checks(scene, wind)
    yield from rising_checks(scene, wind)
    for name in OF_ONE_COLUMN:
        if name in scene.measure:
            yield f"measure.{name} reads a single column of air; leave wind.columns out"
    if "turbulent_gusts" in scene.effects and wind.closure != "mixing_length":
        yield "effects.turbulent_gusts: the grid has gusts of its own; leave the effect or the eddies out"
    yield from courant_checks(scene, wind)


def column_checks(scene: Scene, wind: Wind) -> Iterator[str]:
    """Columns can be paired by the pressure solve, and are wider than grains."""
    diameter = nominal_diameter(scene.grains.size)
    for place, (count, name) in enumerate(zip(wind.columns, ("length", "width"), strict=True)):
        width = getattr(wind, name) / count
        if count < COLUMNS_LEAST or count % 2:
            yield f"wind.columns.{place} = {count}: an even number is needed, at least {COLUMNS_LEAST}"
        elif width < diameter:
            told = "narrower than a grain; averages over them mean nothing"
            yield f"wind.columns.{place} = {count}: columns of {width:.3g} m are {told}"


def rising_checks(scene: Scene, wind: Wind) -> Iterator[str]:
    """Nothing rises through the floor of a grid."""
    if wind.through_flow != 0.0:
        yield "wind.through_flow needs a single column of air; leave wind.columns out"
    for place, stage in enumerate(scene.stages):
        if stage.through_flow is not None:
            yield f"stages.{place}.through_flow needs a single column of air; leave wind.columns out"


def courant_checks(scene: Scene, wind: Wind) -> Iterator[str]:
    """No gust crosses more than a cell from one look to the next."""
    friction = max([wind.friction_velocity, *(stage.friction_velocity or 0.0 for stage in scene.stages)])
    friction = wind.partition * max(friction, scene.threshold.transport or 0.0, scene.threshold.first or 0.0)
    above = wind.height - surface_height(scene, wind)
    roughness = GRAIN_ROUGHNESS * nominal_diameter(scene.grains.size)
    fastest = friction * (log(1.0 + max(above, 0.0) / roughness) / ClosureConstants.karman + GUST)
    flown = fastest * wind.look_steps * time_step(scene)
    most = COURANT_MOST * wind.length / wind.columns[0]
    if flown > most:
        yield (
            f"wind.look_steps = {wind.look_steps}: a gust of {fastest:.3g} m/s crosses {flown:.2g} m of air "
            f"between two looks; at most {int(wind.look_steps * most / flown)}"
        )


LID_LEAST = 20.0  # diameters between bed and lid where wind blows: below, the lid lies in the layer that hops
LOOK_SHARE = 0.1  # of the response of the smallest grain that may pass between two looks at the air [1]
HUNTED = (
    *("rolling_onset", "fluid_threshold", "threshold_u_star", "threshold_wind_speed"),
    *("impact_threshold", "impact_threshold_linear", "threshold_ratio"),
)
SPLASH = ("rebound_share", "rebound_speed", "ejecta_share")
BLOWN = ("pressure_drop", "flux", "flux_height", "bed_stress", "grain_stress", *SPLASH)  # of many moments
REST_LEAST = 0.1  # of sqrt(d / g): a grain that begins to fall is faster by then than one at rest may be [1]
PATCH_GRAINS_LEAST = 6  # in each direction of a periodic patch: else a grain meets its own image


def layer_checks(scene: Scene, fill: Layers, reach: float) -> Iterator[str]:
    """Layers need a patch with room for a few grains in each direction."""
    if scene.wind is None:
        yield "fill.law = 'layers' fills a patch: a [wind] section must state its length and width"
        return
    if fill.pitch - 2.0 * fill.jitter < 2.0 * reach:
        yield (
            f"fill.pitch = {fill.pitch:g} m less twice the jitter is smaller than the largest grain, "
            f"{2.0 * reach:g} m: grains would start inside each other"
        )
    for name, places in zip(("length", "width"), layer_places(scene.wind, fill), strict=True):
        if places < PATCH_GRAINS_LEAST:
            size = getattr(scene.wind, name)
            least = PATCH_GRAINS_LEAST
            yield f"wind.{name} = {size:g} m holds {places} grains of this pitch; at least {least}"


def wind_checks(scene: Scene) -> Iterator[str]:
    """Air, stages and lid fit together."""
    for place, stage in enumerate(scene.stages if scene.wind is None else ()):
        for name in ("friction_velocity", "through_flow"):
            if getattr(stage, name) is not None:
                yield f"stages.{place}.{name} needs a [wind] section"
    yield from threshold_checks(scene)
    yield from measure_checks(scene)
    if scene.wind is not None and scene.grains.clump is not None:
        yield "wind: drag acts on single spheres; grains.clump must be left out"
    if scene.wind is not None:
        yield from lid_checks(scene, scene.wind)
        yield from look_checks(scene, scene.wind)
        yield from grid_checks(scene, scene.wind)
        yield from sleep_checks(scene, scene.wind)


def lid_checks(scene: Scene, wind: Wind) -> Iterator[str]:
    """The lid lies above the bed, and where wind blows above most grains that hop."""
    bed, diameter = surface_height(scene, wind), nominal_diameter(scene.grains.size)
    blows = wind.friction_velocity > 0.0 or any(
        stage.until == "threshold" or stage.friction_velocity for stage in scene.stages
    )
    if bed >= wind.height:
        yield f"wind.height = {wind.height:g} m: the lid lies inside the bed of {bed:.3g} m"
    elif blows and wind.height - bed < LID_LEAST * diameter:
        least = bed + LID_LEAST * diameter
        hops = "the lid lies in the layer where grains hop"
        yield f"wind.height = {wind.height:g} m: {hops}; at least {least:.3g} m"


def look_checks(scene: Scene, wind: Wind) -> Iterator[str]:
    """Grains look before drag has changed their velocity: Stokes' response is rho_p d^2 / (18 mu)."""
    density = scene.materials[scene.grains.material].density
    smallest = size_range(scene.grains.size)[0]
    response = density * smallest**2 / (18.0 * wind.viscosity * wind.density)
    interval = wind.look_steps * time_step(scene)
    if interval > LOOK_SHARE * response:
        yield (
            f"wind.look_steps = {wind.look_steps}: {interval:.2g} s pass between two looks at the air, "
            f"but drag moves the smallest grain within {response:.2g} s; at most a tenth of that"
        )


def sleep_checks(scene: Scene, wind: Wind) -> Iterator[str]:
    """Grains sleep after a rest that tells them from falling ones, on walls that stand still."""
    if wind.sleep_after is None:
        return
    least = REST_LEAST * sqrt(nominal_diameter(scene.grains.size))
    if wind.sleep_after * sqrt(scene.gravity.magnitude) < least:
        told = "so soon, grains that begin to fall seem to be at rest"
        yield f"wind.sleep_after = {wind.sleep_after:g} s: {told}; at least 0.1 sqrt(d / g)"
    # nobody looks at what a wall does to a sleeper
    for place, stage in enumerate(scene.stages):
        for name in stage.move:
            told = "no grain may sleep where walls move; leave wind.sleep_after out"
            yield f"stages.{place}.move.{name}: {told}"


def measure_checks(scene: Scene) -> Iterator[str]:
    """Measures of the wind have what they read."""
    hunts = any(stage.until == "threshold" for stage in scene.stages)
    for name, order in scene.measure.items():
        if name in HUNTED and not hunts:
            yield f"measure.{name} needs a stage with until = 'threshold'"
        if name in BLOWN and scene.wind is None:
            yield f"measure.{name} needs a [wind] section"
        elif name in BLOWN and order.every is None:
            yield f"measure.{name}.every is missing: it is a mean over the stage"


def threshold_checks(scene: Scene) -> Iterator[str]:
    """A hunt for thresholds needs wind, comes last, and looks more than once at the shortest trial."""
    places = [place for place, stage in enumerate(scene.stages) if stage.until == "threshold"]
    if not places:
        return
    place, last = places[0], len(scene.stages) - 1
    if scene.wind is None:
        yield f"stages.{place}.until = 'threshold' needs a [wind] section"
    if place != last:
        yield f"stages.{place}.until = 'threshold' must be the last stage"
    order, interval = scene.threshold, scene.run.check_interval
    for name in ("rise_hold", "hold", "spin_up", "fall_hold"):
        if getattr(order, name) < 2.0 * interval:
            shown = f"threshold.{name} = {getattr(order, name):g} s"
            yield f"{shown} is shorter than two run.check_interval of {interval:g} s"


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
