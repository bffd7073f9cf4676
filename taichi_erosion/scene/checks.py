"""Rules that need the built setup of a scene; each problem is one line that begins with a dotted path.

Rules on the entries of one section, and on names that refer to other sections, stand in `scene/schema/`.
"""

from collections.abc import Collection, Iterator
from math import inf, log, sqrt

import numpy as np
import scipy

from taichi_erosion.core.air_setup import ClosureConstants
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats
from taichi_erosion.scene.preparation import air, limits, sizes
from taichi_erosion.scene.preparation.fill import cubic_lattice, placed_diameters, places_per_layer
from taichi_erosion.scene.preparation.walls import distance_to_wall, surface_of_revolution_rows
from taichi_erosion.scene.schema.air import AirScene, air_box_contradictions
from taichi_erosion.scene.schema.fields import unit_vector
from taichi_erosion.scene.schema.geometry import UPWARDS, Cylinder, Funnel
from taichi_erosion.scene.schema.grains import Bed, Lattice, Layers, Positions, Pour, Rain
from taichi_erosion.scene.schema.scene import Scene, observable_problems, reference_problems
from taichi_erosion.scene.schema.wind import Wind

MOST_SPHERES = 20_000_000  # in all replicas together, about 20 GB of state
MOST_STEPS = 1e10  # a stage longer than this would take weeks
RAYLEIGH_MOST = 0.3  # time step over the Rayleigh time, unless a longer one is forced [1]
MOST_AIR_STEPS = 2_000_000  # likewise of air alone
LARGEST_RATIO = 20.0  # largest over smallest grain; beyond it the neighbour search becomes slow [1]
COURANT_MOST = 1.2  # of the fastest gust expected; the scheme is stable up to 1.7 [1]
GUST = 3.0 * 2.5  # u' that hardly any gust exceeds, over u*: three deviations near a wall [1]
LID_LEAST = 20.0  # diameters between bed and lid where wind blows: below, the lid lies in the layer that hops
EXCHANGE_SHARE = 0.1  # of the response of the smallest grain that may pass between two exchanges [1]
REST_LEAST = 0.1  # of sqrt(d / g): a grain that begins to fall is faster by then than one at rest may be [1]
TOUCH = 1.0 + 1e-9  # of the sum of two radii, at which spheres touch [1]
PARALLEL = 0.999  # cosine between two axes that count as one direction [1]
PATCH_GRAINS_LEAST = 6  # in each direction of a periodic patch: else a grain meets its own image


def scene_contradictions(scene: Scene, observables: Collection[str] | None) -> Iterator[str]:
    """Problems of a scene whose entries are right one by one; a value that cannot be computed is one."""
    lines = list(reference_problems(scene, observables))
    for check in (size_contradictions, wind_contradictions, fill_contradictions, computed_number_problems):
        try:
            lines = lines or list(check(scene))
        except BadInput as error:
            lines = [str(error)]
        except (OverflowError, ZeroDivisionError, FloatingPointError):
            problem = "numbers too extreme to compute a time step; check the units of sizes and materials"
            lines = [f"the file: {problem}"]
    yield from lines


def size_contradictions(scene: Scene) -> Iterator[str]:
    """Sizes that one neighbour search can serve, in replicas that fit into memory."""
    low, high = sizes.size_range(scene.grains)
    if high > LARGEST_RATIO * low:
        ratio = f"the largest may be {LARGEST_RATIO:g} times the smallest"
        yield f"grains.size: diameters from {low:g} to {high:g} m; {ratio}"
    clump, replicas = scene.grains.clump, scene.run.replicas
    if clump is not None:
        centres, radii = (np.array(each) for each in zip(*sizes.spheres_of_clump(clump), strict=True))
        touch = scipy.spatial.distance.cdist(centres, centres) <= TOUCH * np.add.outer(radii, radii)
        if scipy.sparse.csgraph.connected_components(touch, directed=False)[0] > 1:
            yield "grains.clump.spheres: some touch no other; a clump is one grain"
    spheres = scene.grains.count * (len(sizes.spheres_of_clump(clump)) if clump else 1) * replicas
    if spheres > MOST_SPHERES:
        yield f"run.replicas = {replicas}: {spheres} spheres in all replicas; at most {MOST_SPHERES} fit"
    for name, count in sizes.grain_count_of_kinds(scene).items() if scene.fill.law != "positions" else ():
        if count == 0:
            yield f"grains.kinds.{name}.share: no grain of {scene.grains.count}; raise it or grains.count"


def wind_contradictions(scene: Scene) -> Iterator[str]:
    """Air, lid, exchange interval and sleep suit the grains."""
    if scene.wind is not None:
        for check in (lid_problems, exchange_interval_problems, sleep_time_problems, air_grid_contradictions):
            yield from check(scene, scene.wind)


def lid_problems(scene: Scene, wind: Wind) -> Iterator[str]:
    """The lid lies above the bed, and where wind blows above most grains that hop."""
    bed, diameter = air.bed_surface_height(scene, wind), sizes.nominal_diameter(scene.grains)
    blows = wind.friction_velocity > 0.0 or any(
        stage.until == "threshold" or stage.friction_velocity for stage in scene.stages
    )
    if bed >= wind.height:
        yield f"wind.height = {wind.height:g} m: the lid lies inside the bed of {bed:.3g} m"
    elif blows and wind.height - bed < LID_LEAST * diameter:
        least = bed + LID_LEAST * diameter
        hops = "the lid lies in the layer where grains hop"
        yield f"wind.height = {wind.height:g} m: {hops}; at least {least:.3g} m"


def exchange_interval_problems(scene: Scene, wind: Wind) -> Iterator[str]:
    """Exchanges come before drag has changed a velocity: Stokes' response time is rho_p d^2 / (18 mu)."""
    finest = {name: sizes.size_range(part.size)[0] for name, part in scene.grains.parts.items()}
    least = min(m.density * finest[name] ** 2 for name, m in scene.grain_materials.items())
    response = least / (18.0 * wind.viscosity * wind.density)
    interval = wind.look_steps * limits.time_step(scene)
    if interval > EXCHANGE_SHARE * response:
        words = f"{interval:.2g} s pass between two exchanges with the air"
        drag = f"drag moves the smallest grain within {response:.2g} s; at most a tenth of that"
        yield f"wind.look_steps = {wind.look_steps}: {words}, but {drag}"


def sleep_time_problems(scene: Scene, wind: Wind) -> Iterator[str]:
    """The time at rest before sleep tells resting grains from falling ones."""
    if wind.sleep_after is None:
        return
    least = REST_LEAST * sqrt(sizes.nominal_diameter(scene.grains))
    if wind.sleep_after * sqrt(scene.gravity.magnitude) < least:
        reason = "so soon, grains that begin to fall seem to be at rest"
        yield f"wind.sleep_after = {wind.sleep_after:g} s: {reason}; at least 0.1 sqrt(d / g)"


def air_grid_contradictions(scene: Scene, wind: Wind) -> Iterator[str]:
    """Columns of a grid are wider than grains, and no gust crosses more than a cell between two exchanges."""
    if wind.columns == (1, 1):
        return
    for place, (count, size) in enumerate(zip(wind.columns, (wind.length, wind.width), strict=True)):
        if size / count < sizes.nominal_diameter(scene.grains):
            reason = "narrower than a grain; averages over them mean nothing"
            yield f"wind.columns.{place} = {count}: columns of {size / count:.3g} m are {reason}"
    friction = max([wind.friction_velocity, *(stage.friction_velocity or 0.0 for stage in scene.stages)])
    friction = wind.partition * max(friction, scene.threshold.transport or 0.0, scene.threshold.first or 0.0)
    above = wind.height - air.bed_surface_height(scene, wind)
    roughness = air.GRAIN_ROUGHNESS * sizes.nominal_diameter(scene.grains)
    fastest = friction * (log(1.0 + max(above, 0.0) / roughness) / ClosureConstants.karman + GUST)
    flown = fastest * wind.look_steps * limits.time_step(scene)
    most = COURANT_MOST * wind.length / wind.columns[0]
    if flown > most:
        words = f"a gust of {fastest:.3g} m/s crosses {flown:.2g} m of air between two exchanges"
        yield f"wind.look_steps = {wind.look_steps}: {words}; at most {int(wind.look_steps * most / flown)}"


def fill_contradictions(scene: Scene) -> Iterator[str]:
    """Grains start apart and find room."""
    fill, largest = scene.fill, sizes.size_range(scene.grains)[1]
    share = sizes.bounding_radius_ratio(scene.grains)
    reach, mean = share * largest, min(sizes.scene_mean_cubed_diameter(scene) ** (1.0 / 3.0), largest)
    if isinstance(fill, Positions):
        yield from placed_grain_problems(scene, fill)
    elif isinstance(fill, Layers) and scene.periods_xy is None:
        words = "a [wind] section must state its length and width, or [domain] its period"
        yield f"fill.law = 'layers' fills a patch: {words}"
    elif scene.domain.period is not None and not isinstance(fill, Layers | Bed):
        yield f"fill.law = '{fill.law}': a periodic box is filled by 'layers', 'positions' or 'bed'"
    elif not isinstance(fill, Layers | Bed) and (lines := list(start_room_problems(scene, fill, reach))):
        yield from lines
    elif not isinstance(fill, Bed | Pour):
        yield from net_problems(scene, fill, 2.0 * share * (mean if isinstance(fill, Rain) else largest))


def start_room_problems(scene: Scene, fill: Rain | Lattice | Pour, reach: float) -> Iterator[str]:
    """Grains of some reach [m] start inside their fill or inlets, and inside tubes and funnels about them."""
    yield from inlet_contradictions(scene, fill) if isinstance(fill, Pour) else ()
    for path, start, axis, radius, narrowest in start_discs(fill):
        if narrowest < reach:
            yield f"{path} = {narrowest:g} m is smaller than a grain's reach of {reach:g} m"
            continue
        tubes = [(name, wall) for name, wall in scene.geometry.items() if isinstance(wall, Cylinder | Funnel)]
        for name, row in ((name, row) for name, wall in tubes for row in surface_of_revolution_rows(wall)):
            arm, own_axis = np.subtract(start, row[:3]), np.array(row[3:6])
            along = float(arm @ own_axis)
            across = float(np.linalg.norm(arm - along * own_axis))
            inner = float(np.interp(along, row[7::2], row[6::2], left=inf, right=inf))
            if abs(axis @ own_axis) > PARALLEL and across < inner < across + radius:
                reason = f"geometry.{name} has a radius of {inner:g} m there"
                yield f"{path} = {radius:g} m: grains would start outside the wall; {reason}"


def start_discs(fill: Rain | Lattice | Pour) -> Iterator[tuple[str, Floats, Floats, float, float]]:
    """Discs where grains start: path of the radius, middle [m], axis, radius and least half width [m]."""
    upwards = np.array(UPWARDS)
    if isinstance(fill, Rain):
        start = np.add(fill.axis_point, fill.first_height * upwards)
        yield "fill.radius", start, upwards, fill.radius, fill.radius
    elif isinstance(fill, Lattice):
        yield "fill.radius", np.array(fill.centre), np.array(unit_vector(fill.axis)), fill.radius, fill.radius
    inlets = fill.parts if isinstance(fill, Pour) else {}
    for path, inlet in [(path, each) for path, each in inlets.items() if not each.mesh]:
        shape = "radius" if inlet.radius else "size" if inlet.size else "end"
        narrowest = 0.5 * min(inlet.size) if inlet.size else inlet.reach
        yield f"{path}.{shape}", np.array(inlet.middle), upwards, inlet.reach, narrowest


def inlet_contradictions(scene: Scene, fill: Pour) -> Iterator[str]:
    """Every kind of grains has an inlet, from which it falls."""
    passing, kinds = {inlet.kind for inlet in fill.parts.values()}, set(scene.grains.kinds)
    for kind in sorted(kinds - passing) if None not in passing else ():
        yield f"fill.inlets: none of them lets '{kind}' pass; name it as the kind of one"
    for path, inlet in fill.parts.items():
        if inlet.kind is not None and inlet.kind not in kinds:
            yield f"{path}.kind = '{inlet.kind}' is not among [grains.kinds]"
        if inlet.speed == 0.0 and scene.gravity.magnitude == 0.0:
            yield f"{path}.speed = 0.0 without gravity: poured grains would never fall"


def net_problems(scene: Scene, fill: Rain | Lattice | Layers, size: float) -> Iterator[str]:
    """A net has enough places and is wider than the largest grain [m]; of rain, than the mean one."""
    if fill.pitch - 2.0 * fill.jitter < size:
        which = "mean" if isinstance(fill, Rain) else "largest"
        words = f"less twice the jitter is smaller than the {which} grain, {size:g} m"
        yield f"fill.pitch = {fill.pitch:g} m {words}: grains would start inside each other"
    elif isinstance(fill, Lattice):
        cells = (2.0 * fill.radius + fill.length) ** 3 / fill.pitch**3
        places = len(cubic_lattice(fill)) if cells < MOST_SPHERES else MOST_SPHERES
        if places < scene.grains.count:
            yield f"grains.count = {scene.grains.count}: the fill has {places} places"
    if isinstance(fill, Layers) and scene.periods_xy is not None:
        ends = ("domain.period.0", "domain.period.1") if scene.wind is None else ("wind.length", "wind.width")
        sides = zip(ends, scene.periods_xy, places_per_layer(scene.periods_xy, fill), strict=True)
        for name, size, places in sides:
            if places < PATCH_GRAINS_LEAST:
                least = PATCH_GRAINS_LEAST
                yield f"{name} = {size:g} m holds {places} grains of this pitch; at least {least}"


def placed_grain_problems(scene: Scene, fill: Positions) -> Iterator[str]:
    """Explicitly placed grains are as many as stated, and apart from each other and from walls."""
    if len(fill.grains) != scene.grains.count:
        yield f"grains.count = {scene.grains.count}, but fill.grains lists {len(fill.grains)}"
        return
    kinds = scene.grains.kinds or {None: None}
    for wrong in [k for k, grain in enumerate(fill.grains) if grain.kind not in kinds]:
        names = ", ".join(scene.grains.kinds) or "none"
        yield f"fill.grains.{wrong}.kind must be one of [grains.kinds]: {names}"
        return
    centres = np.array([grain.position for grain in fill.grains])
    radius = sizes.bounding_radius_ratio(scene.grains) * placed_diameters(scene, fill)
    for i, j in sorted(scipy.spatial.KDTree(centres).query_pairs(2.0 * float(radius.max()))):
        overlap = radius[i] + radius[j] - float(np.linalg.norm(centres[i] - centres[j]))
        if overlap > scene.run.overlap_limit * min(radius[i], radius[j]):
            yield f"fill.grains.{j} overlaps fill.grains.{i} by {overlap:.3g} m"
    for name in scene.geometry if scene.grains.clump is None else ():
        for i, gap in enumerate(distance_to_wall(scene, name, centres)):
            if radius[i] - gap > scene.run.overlap_limit * radius[i]:
                yield f"fill.grains.{i} overlaps geometry.{name} by {radius[i] - gap:.3g} m"


def computed_number_problems(scene: Scene) -> Iterator[str]:
    """Mesh files can be read; time step and stiffness are within their limits."""
    rayleigh, chosen = limits.grain_rayleigh_time(scene), limits.time_step(scene)
    if chosen > RAYLEIGH_MOST * rayleigh and not scene.run.force_time_step:
        key = "time_step" if scene.run.time_step is not None else "time_step_fraction"
        step = f"a step of {chosen:.3g} s is {chosen / rayleigh:.3g} Rayleigh times ({rayleigh:.3g} s)"
        yield f"run.{key}: {step}; at most {RAYLEIGH_MOST} unless run.force_time_step = true"
        return
    steps = sum(stage.duration_max for stage in scene.stages) / chosen
    if steps > MOST_STEPS:
        yield f"stages: {steps:.2g} steps of {chosen:.2g} s; soften grains or shorten stages"
    speed = limits.largest_expected_speed(scene)
    for name, radius, mass, young in limits.smallest_grains_of_kinds(scene):
        overlap = limits.impact_overlap(0.5 * mass, 0.5 * radius, young, speed) / radius
        if overlap > scene.run.overlap_limit:
            words = f"an impact at {speed:.3g} m s-1 would overlap by {overlap:.2g} radii"
            yield f"materials.{name}: too soft: {words}; run.overlap_limit is {scene.run.overlap_limit:g}"


def air_faults(scene: AirScene, observables: Collection[str] | None) -> Iterator[str]:
    """Problems of a scene of air alone whose entries are right one by one."""
    yield from observable_problems(scene.measure, observables)
    yield from list(air_box_contradictions(scene.air)) or roughness_and_step_problems(scene)


def roughness_and_step_problems(scene: AirScene) -> Iterator[str]:
    """Roughness lengths lie below the centres of cells at walls; the time step follows the fastest wind."""
    layers = air.cell_face_heights(scene.air)
    for name, lowest in (("z_low", layers[1]), ("z_high", scene.air.extents[2] - layers[-2])):
        side = scene.air.sides[name]
        if side.kind == "rough" and 0.5 * lowest < side.roughness_length:
            yield f"air.sides.{name}.roughness_length = {side.roughness_length:g} m exceeds half a cell there"
    step, longest = air.run_time_step(scene), air.stable_step(scene)
    if step > longest * (1.0 + 1e-9):
        reason = "lets wind or diffusion cross more than a cell (CFL)"
        yield f"run.time_step = {step:g} s {reason}; at most {longest:.3g} s"
    if scene.run.duration / step > MOST_AIR_STEPS:
        steps = f"{scene.run.duration / step:.2g} steps of {step:.2g} s"
        yield f"run.duration: {steps}; at most {MOST_AIR_STEPS:g}"
