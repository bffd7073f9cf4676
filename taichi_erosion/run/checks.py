"""Checks of a scene that need no device: validation, and compatibility with others in one ensemble."""

import json
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.measures.boundary_layer import AIR_OBSERVABLES
from taichi_erosion.run.observables import OBSERVABLES
from taichi_erosion.scene import Scene, explain, laws, load_scene, resolved, scene_hash
from taichi_erosion.scene.build.air import air_time_step, longest_step
from taichi_erosion.scene.load import is_air_scene, load_air_scene
from taichi_erosion.scene.schema.air import AirScene

MIXABLE_PLACES = ("pair", "scene", "instrument")  # effects that replicas of one ensemble need not share


def read_scene(path: Path, overrides: tuple[str, ...], effect_files: tuple[Path, ...] = ()) -> Scene:
    """Load a scene whose measures and effects this program knows. Raises BadInput."""
    scene = load_scene(path, overrides, observables=tuple(OBSERVABLES))
    if scene.effects or effect_files:
        known = effect_parameters(effect_files)
        scene = load_scene(path, overrides, effects=known, observables=tuple(OBSERVABLES))
    return scene


def read_air_scene(path: Path, overrides: tuple[str, ...] = ()) -> AirScene:
    """Load an air scene whose measures this program knows. Raises BadInput."""
    return load_air_scene(path, overrides, observables=tuple(AIR_OBSERVABLES))


def effect_parameters(files: tuple[Path, ...]) -> dict[str, tuple[str, ...]]:
    """Entries that a scene may give, by effect; the library is loaded here, since most scenes need none."""
    from taichi_erosion.core.effect import parameter_names
    from taichi_erosion.effects import load_library

    return {name: parameter_names(effect) for name, effect in load_library(files).items()}


def check_scene(
    path: Path, overrides: tuple[str, ...] = (), effect_files: tuple[Path, ...] = ()
) -> dict[str, Any]:
    """Hash, resolved scene, time-step limits and warnings; starts no device. Raises BadInput."""
    if is_air_scene(path):
        scene = read_air_scene(path, overrides)
        limits = {"time_step": air_time_step(scene), "time_step_longest": longest_step(scene), "warnings": []}
    else:
        scene = read_scene(path, overrides, effect_files)
        limits = explain(scene)
    return {"scene": str(path), "hash": scene_hash(scene), "resolved": resolved(scene), "limits": limits}


def compatibility_key(scene: Scene) -> str:
    """All that is compiled into the kernels, and the check interval; equal for scenes of one ensemble.

    Replicas with and without an attraction between grains, a change of the scene or an instrument run beside
    each other and come out bit for bit as alone.
    """
    effective, effects = compiled_effects(scene)
    clumped = effective.grains.clump is not None
    choices = [scene.scene.kind, asdict(laws(effective)), scene.run.precision, clumped, effects]
    return json.dumps([*choices, scene.run.check_interval, air_layer_key(effective)], sort_keys=True)


def compiled_effects(scene: Scene) -> tuple[Scene, list[tuple[str, bool]]]:
    """The scene changed by its effects, and (name, strength > 0) of the effects that are compiled in.

    Where an effect is not in the library or refuses the scene, all count as compiled in: its replica then
    fails by itself.
    """
    named = sorted((name, entry.get("strength", 1.0) > 0.0) for name, entry in scene.effects.items())
    if not named:
        return scene, named
    from taichi_erosion.simulation.scene_setup import effective_scene

    library = package_effects()
    try:
        compiled = [(name, acts) for name, acts in named if library[name].place not in MIXABLE_PLACES]
        return effective_scene(scene, library), compiled
    except (BadInput, KeyError):
        return scene, named


@cache
def package_effects() -> dict[str, Any]:
    """The library of the package, loaded only where a scene names effects."""
    from taichi_erosion.effects import load_library

    return load_library()


def air_layer_key(scene: Scene) -> Any:
    """Entries that fix the layers of the air, and whether air may rise; None without wind."""
    if scene.wind is None:
        return None
    rising = any(stage.through_flow is not None for stage in scene.stages)
    names = {"closure", "columns", "drive", "surface", "length", "width", "height", "cell", "growth"}
    return [scene.wind.model_dump(include=names), rising, scene.grains.count, scene.grains.size.model_dump()]
