"""Validating a scene without simulating it."""

from pathlib import Path
from typing import Any

from taichi_erosion.run.air_check import check_air_scene
from taichi_erosion.run.observables import OBSERVABLES
from taichi_erosion.scene import Scene, explain, load_scene, resolved, scene_hash
from taichi_erosion.scene.air import is_air_scene


def read_scene(path: Path, overrides: tuple[str, ...], effect_files: tuple[Path, ...] = ()) -> Scene:
    """Load a scene whose measures and effects this program knows. Raises BadInput."""
    scene = load_scene(path, overrides, observables=tuple(OBSERVABLES))
    if scene.effects or effect_files:
        known = effect_parameters(effect_files)
        scene = load_scene(path, overrides, effects=known, observables=tuple(OBSERVABLES))
    return scene


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
        return check_air_scene(path, overrides)
    scene = read_scene(path, overrides, effect_files)
    document = {"scene": str(path), "hash": scene_hash(scene)}
    return document | {"resolved": resolved(scene), "limits": explain(scene)}
