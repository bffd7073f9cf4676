"""One run: scene file -> simulate -> measure -> record -> result."""

from taichi_erosion.run.check import check_scene
from taichi_erosion.run.options import RunOptions
from taichi_erosion.run.scene_run import run_scene

__all__ = ["RunOptions", "check_scene", "run_scene"]
