"""Validating a scene without simulating it."""

from pathlib import Path
from typing import Any

from taichi_erosion.run.observables import OBSERVABLES
from taichi_erosion.scene import Scene, explain, load_scene, resolved, scene_hash


def read_scene(path: Path, overrides: tuple[str, ...]) -> Scene:
    """Load a scene whose measures and effects this program knows. Raises BadInput."""
    return load_scene(path, overrides, effects={}, observables=tuple(OBSERVABLES))


def check_scene(path: Path, overrides: tuple[str, ...] = ()) -> dict[str, Any]:
    """Hash, resolved scene, time-step limits and warnings; never touches Taichi. Raises BadInput."""
    scene = read_scene(path, overrides)
    document = {"scene": str(path), "hash": scene_hash(scene)}
    return document | {"resolved": resolved(scene), "limits": explain(scene)}
