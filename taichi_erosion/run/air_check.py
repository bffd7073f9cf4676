"""Validating an air scene without simulating it, and what can be measured in one."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from taichi_erosion.measures import boundary_layer
from taichi_erosion.measures.boundary_layer import AirEvidence
from taichi_erosion.measures.result import Measurement
from taichi_erosion.scene.air import air_hash, load_air_scene, resolved_air
from taichi_erosion.scene.air_grid import longest_step, time_step
from taichi_erosion.scene.schema_air import AirScene

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
