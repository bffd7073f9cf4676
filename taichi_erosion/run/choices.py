"""What the scenes of one ensemble must have in common."""

import json

from taichi_erosion.scene import Scene


def shared_choices(scene: Scene) -> str:
    """What a scene asks to be compiled in, and its check interval; equal for all replicas of an ensemble."""
    effects = sorted((name, entry.get("strength", 1.0) > 0.0) for name, entry in scene.effects.items())
    clumped = scene.grains.clump is not None
    choices = [scene.scene.kind, scene.laws.model_dump(), scene.run.precision, clumped, effects]
    return json.dumps([*choices, scene.run.check_interval], sort_keys=True)
