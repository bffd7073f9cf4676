"""What a campaign is asked to run, and what comes back.

A request is addressed by its content: the scene (with all that can change its result), the seed and the
version of this package make its key, and a key is never run twice in one ledger.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import nan
from pathlib import Path
from typing import Any

from taichi_erosion import __version__
from taichi_erosion.run.checks import compatibility_key, read_scene
from taichi_erosion.scene import Scene, resolved, scene_hash
from taichi_erosion.scene.build.limits import time_step

WORTH_A_START = 2e7  # grain-steps that take as long as to start an ensemble: about four seconds of one core


@dataclass(frozen=True)
class RunRequest:
    """One run; `payload` is what the run function receives, as JSON can hold it."""

    key: str  # same key, same result
    payload: dict[str, Any]
    group: str = ""  # requests of one group may go to one process as one ensemble
    work: float = WORTH_A_START  # grain-steps


@dataclass(frozen=True)
class RunResult:
    """What came out of one run; a run that failed is a result too, with its reason."""

    key: str
    record: dict[str, Any] = field(default_factory=dict)  # what the run function told
    failure: str | None = None
    wall_s: float = 0.0

    def value(self, observable: str) -> float:
        """Measured value in the observable's unit, NaN where the run has none."""
        found = self.record.get("measures", {}).get(observable, {}).get("value")
        return nan if found is None else float(found)


def scene_request(path: Path, overrides: Sequence[str], seed: int, **extra: Any) -> RunRequest:
    """Request of one scene file with PATH=VALUE overrides and a seed. Raises BadInput for what cannot run.

    `extra` may be `record` (file of a recording) and `properties` (columns of rerun's table of runs, by
    group); neither changes a result, so neither is in the key.
    """
    return request_of(read_scene(path, tuple(overrides)), seed, **extra)


def request_of(
    scene: Scene,
    seed: int,
    record: Path | None = None,
    properties: Mapping[str, Mapping[str, Any]] | None = None,
) -> RunRequest:
    """Request of a scene that has been read."""
    payload = {
        "scene": resolved(scene),
        "folder": str(scene.folder.resolve()),
        "seed": seed,
        "record": None if record is None else str(record.resolve()),
        "properties": {group: dict(columns) for group, columns in (properties or {}).items()},
    }
    key = f"{scene_hash(scene)}-{seed}-{__version__}"
    return RunRequest(key, payload, compatibility_key(scene), work_of(scene))


def work_of(scene: Scene) -> float:
    """Most grain-steps that a run of this scene can take."""
    duration = sum(stage.duration_max for stage in scene.stages)
    return scene.grains.count * duration / time_step(scene)
