"""What the scenes of one ensemble must have in common."""

import json
from dataclasses import asdict
from typing import Any

from taichi_erosion.scene import Scene, laws


def shared_choices(scene: Scene) -> str:
    """What a scene asks to be compiled in, and its check interval; equal for all replicas of an ensemble."""
    effects = sorted((name, entry.get("strength", 1.0) > 0.0) for name, entry in scene.effects.items())
    clumped = scene.grains.clump is not None
    choices = [scene.scene.kind, asdict(laws(scene)), scene.run.precision, clumped, effects]
    return json.dumps([*choices, scene.run.check_interval, layers_of_air(scene)], sort_keys=True)


def layers_of_air(scene: Scene) -> Any:
    """What the layers of air follow from, and whether air may rise; None without wind."""
    if scene.wind is None:
        return None
    rising = any(stage.through_flow is not None for stage in scene.stages)
    own = scene.wind.model_dump(include={"closure", "surface", "length", "width", "height", "cell", "growth"})
    return [own, rising, scene.grains.count, scene.grains.size.model_dump()]
