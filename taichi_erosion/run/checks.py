"""Validating an air scene without simulating it, and what can be measured in one.

Validating a scene without simulating it.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from taichi_erosion.measures import boundary_layer
from taichi_erosion.measures.boundary_layer import AirEvidence
from taichi_erosion.measures.result import Measurement
from taichi_erosion.run.observables import OBSERVABLES
from taichi_erosion.scene import Scene, explain, load_scene, resolved, scene_hash
from taichi_erosion.scene.air_scene import (
    air_hash,
    is_air_scene,
    load_air_scene,
    longest_step,
    resolved_air,
    time_step,
)
from taichi_erosion.scene.schema.air import AirScene

AIR_OBSERVABLES: dict[str, Callable[[AirEvidence], Measurement]] = {
    "layer_thickness": boundary_layer.layer_thickness,
    "displacement_thickness": boundary_layer.displacement_thickness,
    "momentum_thickness": boundary_layer.momentum_thickness,
    "friction_velocity": boundary_layer.friction_velocity,
    "friction_velocity_fit": boundary_layer.friction_velocity_fit,
    "wind_aloft": boundary_layer.wind_aloft,
    "speed_least": boundary_layer.speed_least,
}


def read_air_scene(path: Path, overrides: tuple[str, ...] = ()) -> AirScene:
    """Load an air scene whose measures this program knows. Raises BadInput."""
    return load_air_scene(path, overrides, observables=tuple(AIR_OBSERVABLES))


def check_air_scene(path: Path, overrides: tuple[str, ...] = ()) -> dict[str, Any]:
    """Hash, resolved scene and time step; starts no device. Raises BadInput."""
    scene = read_air_scene(path, overrides)
    limits = {"time_step": time_step(scene), "time_step_longest": longest_step(scene), "warnings": []}
    return {"scene": str(path), "hash": air_hash(scene), "resolved": resolved_air(scene), "limits": limits}


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
