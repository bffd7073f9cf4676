"""What the scenes of one ensemble must have in common."""

import json
from dataclasses import asdict
from functools import cache
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import Scene, laws

MIXED = ("pair", "scene", "instrument")  # places of effects beside which replicas without them can run


def shared_choices(scene: Scene) -> str:
    """What a scene asks to be compiled in, and its check interval; equal for all replicas of an ensemble.

    Replicas with and without a pull between grains, or a change of the scene or of what is read, run beside
    each other and come out bit for bit as alone.
    """
    changed, effects = after_effects(scene)
    clumped = changed.grains.clump is not None
    choices = [scene.scene.kind, asdict(laws(changed)), scene.run.precision, clumped, effects]
    return json.dumps([*choices, scene.run.check_interval, layers_of_air(changed)], sort_keys=True)


def after_effects(scene: Scene) -> tuple[Scene, list[tuple[str, bool]]]:
    """The scene after its effects, and those that have to be compiled in, with whether they act.

    Where one of them is not in the library or refuses the scene, all count as compiled in: its replica then
    fails by itself.
    """
    said = sorted((name, entry.get("strength", 1.0) > 0.0) for name, entry in scene.effects.items())
    if not said:
        return scene, said
    from taichi_erosion.simulation.scene_setup import effective_scene

    library = effects_of_package()
    try:
        compiled = [(name, acts) for name, acts in said if library[name].place not in MIXED]
        return effective_scene(scene, library), compiled
    except (BadInput, KeyError):
        return scene, said


@cache
def effects_of_package() -> dict[str, Any]:
    """The library, read once and only where a scene names effects."""
    from taichi_erosion.effects import load_library

    return load_library()


def layers_of_air(scene: Scene) -> Any:
    """What the layers of air follow from, and whether air may rise; None without wind."""
    if scene.wind is None:
        return None
    rising = any(stage.through_flow is not None for stage in scene.stages)
    named = {"closure", "columns", "drive", "surface", "length", "width", "height", "cell", "growth"}
    own = scene.wind.model_dump(include=named)
    return [own, rising, scene.grains.count, scene.grains.size.model_dump()]
