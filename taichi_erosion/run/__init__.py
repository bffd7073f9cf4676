"""One run: scene file -> simulate -> measure -> record -> result."""

from pathlib import Path
from typing import Any

from taichi_erosion.run.checks import check_scene
from taichi_erosion.run.options import RunOptions
from taichi_erosion.scene.air_scene import is_air_scene

__all__ = ["RunOptions", "check_scene", "run_scene"]


def run_scene(path: Path, options: RunOptions) -> dict[str, Any]:
    """Simulate, measure and record a scene; the device is loaded here, since a check needs none."""
    if is_air_scene(path):
        from taichi_erosion.run import air_run

        return air_run.run_air_scene(path, options)
    from taichi_erosion.run import scene_run

    return scene_run.run_scene(path, options)
