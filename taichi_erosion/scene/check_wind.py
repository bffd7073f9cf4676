"""Whether a patch under wind fits together; each problem is one line that begins with a dotted path."""

from collections.abc import Iterator

from taichi_erosion.scene.fill import layer_places
from taichi_erosion.scene.schema import Scene
from taichi_erosion.scene.schema_grains import Layers
from taichi_erosion.scene.wind import surface_height

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
    if scene.wind is not None and scene.grains.clump is not None:
        yield "wind: drag acts on single spheres; grains.clump must be left out"
    if scene.wind is not None:
        bed = surface_height(scene, scene.wind)
        if bed >= scene.wind.height:
            yield f"wind.height = {scene.wind.height:g} m: the lid lies inside the bed of {bed:.3g} m"


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
