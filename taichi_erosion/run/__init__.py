"""One run: scene file -> simulate -> measure -> record -> result."""

from pathlib import Path
from typing import Any

from taichi_erosion.run.checks import check_scene
from taichi_erosion.run.options import RunOptions
from taichi_erosion.scene.load import is_air_scene

__all__ = ["RunOptions", "check_scene", "run_scene"]


def run_scene(path: Path, options: RunOptions) -> dict[str, Any]:
    """Run a scene of grains or of air alone; imports the device, which `check_scene` does not need."""
    if is_air_scene(path):
        from taichi_erosion.run.air_run import run_air_scene as run
    else:
        from taichi_erosion.run.scene_run import run_scene as run
    return run(path, options)
