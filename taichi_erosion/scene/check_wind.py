"""Whether a patch under wind fits together; each problem is one line that begins with a dotted path."""

from collections.abc import Iterator
from math import sqrt

from taichi_erosion.scene.check_grid import grid_checks
from taichi_erosion.scene.fill import layer_places
from taichi_erosion.scene.limits import time_step
from taichi_erosion.scene.schema import Scene
from taichi_erosion.scene.schema_grains import Layers
from taichi_erosion.scene.schema_wind import Wind
from taichi_erosion.scene.sizes import nominal_diameter, size_range
from taichi_erosion.scene.wind import surface_height

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
