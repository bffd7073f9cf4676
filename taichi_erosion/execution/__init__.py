"""One run: scene file -> simulate -> measure -> record -> result.

The result document, printed by `run --json`, is described in `execution.result`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any, Literal

from taichi_erosion.core.setup import ArchChoice, Decomposition
from taichi_erosion.execution.checks import check_scene
from taichi_erosion.scene.load import is_air_scene

Report = Callable[[float, str], None]  # (share done [1], words)


@dataclass(frozen=True)
class RunOptions:
    """Options of a run beside its scene, as `./erosion run` sets them; None leaves a choice to the scene."""

    overrides: tuple[str, ...] = ()
    seed: int | None = None
    replicas: int | None = None
    arch: ArchChoice = "cpu"
    decomposition: Decomposition | None = None  # None: as the device has it
    threads: int = 0
    precision: Literal["f32", "f64"] | None = None
    record: Path | None = None
    no_record: bool = False
    checkpoint: Path | None = None
    checkpoint_interval: float = inf  # simulated s, --every; infinite: one at the end or at an interruption
    resume: Path | None = None
    effect_files: tuple[Path, ...] = ()  # effects from outside the package
    force: bool = False  # replace files of the same name that no run of this scene wrote
    progress: Report | None = None


def run_scene(path: Path, options: RunOptions) -> dict[str, Any]:
    """Run a scene of grains or of air alone; imports the device, which `check_scene` does not need."""
    if is_air_scene(path):
        from taichi_erosion.execution.air_run import run_air_scene as run
    else:
        from taichi_erosion.execution.scene_run import run_scene as run
    return run(path, options)
