"""Setup of one replica from a scene with its optional physics."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from taichi_erosion.core.effect import Conditions, Effect, ReplicaEffect, read_effect_entries, replica_effect
from taichi_erosion.core.effect_file import ON_DEVICE, failures_of
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Setup
from taichi_erosion.scene import Scene, parse_scene, replica_setup, resolve
from taichi_erosion.scene.preparation.air import bed_surface_height
from taichi_erosion.scene.preparation.sizes import nominal_diameter

Library = Mapping[str, Effect]


def effect_conditions(after: Scene) -> dict[str, float]:
    """Conditions for effects on the device and instruments: those stated, and what the scene adds to them.

    The scene is that after the effects that change it.
    """
    grains = after.grains
    of_scene = {"grain_diameter": nominal_diameter(grains), "adhesion_scale": grains.adhesion_scale}
    if after.wind is not None:
        of_scene["bed_height"] = bed_surface_height(after, after.wind)
        of_scene["density_ratio"] = after.grain_density / after.wind.density
    return after.conditions.values_in_si() | of_scene


def effective_scene(scene: Scene, library: Library) -> Scene:
    """The scene after all effects that change it before it is built; those of strength 0 leave no trace.

    What comes out is validated like a file. Raises BadInput where it cannot be simulated.
    """
    conditions, changed = scene.conditions.values_in_si(), scene
    for name in sorted(scene.effects):
        effect = library[name]
        params, strength = effect_params(scene, effect)
        if effect.place == "scene" and strength > 0.0:
            changed = scene_changed_by(effect, params, strength, conditions, changed)
    if changed is scene:
        return scene
    return parse_scene(resolve(changed), f"{scene.file} with its effects", scene.folder)


def scene_changed_by(
    effect: Effect, params: object, strength: float, conditions: Conditions, scene: Scene
) -> Scene:
    """The scene after one effect. Raises BadInput where the effect refuses it."""
    try:
        with failures_of(effect, "act"):
            changed = effect.act(params, strength, conditions, scene)
        if not isinstance(changed, Scene):
            raise BadInput(f"effects.{effect.name}: its act gives {changed!r}, not the scene")
        return changed
    except BadInput as error:
        raise BadInput(f"{scene.file}: {error}") from None


def prepare(scene: Scene, seed: int, library: Library) -> Setup:
    """Setup of one replica with all effects in it. Raises BadInput for parameters out of range."""
    after = effective_scene(scene, library)
    setup = replica_setup(after, seed)
    largest = float(setup.grains.radius.max())
    effects = tuple(device_effects(after, library, largest))
    return replace(setup, effects=effects)


def device_effects(after: Scene, library: Library, radius: float) -> list[ReplicaEffect]:
    """Effects on the device that have a strength, in the order of their names; `after` those of the scene."""
    effects, circumstances = [], effect_conditions(after)
    for name in sorted(after.effects):
        effect = library[name]
        params, strength = effect_params(after, effect)
        if effect.place in ON_DEVICE and strength > 0.0:
            with failures_of(effect, "constants"):
                effects.append(replica_effect(effect, params, strength, circumstances, radius))
    return effects


def can_effect_act_in_scene(scene: Scene, effect: Effect) -> bool:
    """Whether an effect can act under the conditions that a scene states."""
    values = {name: np.array([v]) for name, v in scene.conditions.values_in_si().items()}
    with failures_of(effect, "can_act"):
        return bool(np.all(effect.can_act(values)))


def does_effect_change_scene(scene: Scene, effect: Effect) -> bool:
    """Whether an effect of a scene changes it, a reading of its measures, or a number on the device."""
    params, strength = effect_params(scene, effect)
    at = effect_conditions(scene)
    if effect.place == "scene":
        return scene_changed_by(effect, params, strength, scene.conditions.values_in_si(), scene) != scene
    if effect.place == "instrument":
        return any(effect.act(params, strength, at, name, 1.0) != 1.0 for name in scene.measure)
    assert effect.constants is not None
    blows = scene.wind is not None or not effect.through_air
    return blows and effect.constants(params, strength, at) != effect.constants(params, 0.0, at)


def effect_params(scene: Scene, effect: Effect) -> tuple[object, float]:
    """Parameters and strength as the scene states them."""
    try:
        return read_effect_entries(effect, scene.effects[effect.name])
    except ValueError as error:
        raise BadInput(f"{scene.file}: {error}") from None
