"""What the scenes of one ensemble must have in common."""

import json
from dataclasses import asdict
from functools import cache
from typing import Any

from taichi_erosion.core.effect import STRENGTH
from taichi_erosion.core.errors import BadInput
from taichi_erosion.effects import load_library
from taichi_erosion.scene import Scene, laws
from taichi_erosion.simulation.prepare import effective_scene

COMPILED = ("grain", "meeting")  # places of effects that a replica without them is not mixed with
library = cache(load_library)


def shared_choices(scene: Scene) -> str:
    """What a scene asks to be compiled in, and its check interval; equal for all replicas of an ensemble.

    Replicas with and without a pull between grains, or a change of the scene or of what is read, run beside
    each other and come out bit for bit as alone.
    """
    changed = changed_scene(scene)
    effects = sorted(
        (name, entry.get(STRENGTH, 1.0) > 0.0)
        for name, entry in scene.effects.items()
        if name not in library() or library()[name].place in COMPILED
    )
    clumped = changed.grains.clump is not None
    choices = [scene.scene.kind, asdict(laws(changed)), scene.run.precision, clumped, effects]
    return json.dumps([*choices, scene.run.check_interval, layers_of_air(changed)], sort_keys=True)


def changed_scene(scene: Scene) -> Scene:
    """The scene after its effects; as it stands where one of them refuses it or is not in the library."""
    if not scene.effects or not library().keys() >= scene.effects.keys():
        return scene
    try:
        return effective_scene(scene, library())
    except BadInput:
        return scene


def layers_of_air(scene: Scene) -> Any:
    """What the layers of air follow from, and whether air may rise; None without wind."""
    if scene.wind is None:
        return None
    rising = any(stage.through_flow is not None for stage in scene.stages)
    own = scene.wind.model_dump(include={"closure", "surface", "length", "width", "height", "cell", "growth"})
    return [own, rising, scene.grains.count, scene.grains.size.model_dump()]
