"""Options of a run beside its scene; the words of `./erosion run` set them."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Literal

CHECKPOINT_INTERVAL = inf  # simulated s; infinite: one checkpoint, at the end or at an interruption

Report = Callable[[float, str], None]  # (share done [1], words)


@dataclass(frozen=True)
class RunOptions:
    """Options of `run`; None leaves a choice to the scene."""

    overrides: tuple[str, ...] = ()
    seed: int | None = None
    replicas: int | None = None
    arch: Literal["cpu", "cuda"] = "cpu"
    threads: int = 0
    precision: Literal["f32", "f64"] | None = None
    record: Path | None = None
    no_record: bool = False
    checkpoint: Path | None = None
    checkpoint_interval: float = CHECKPOINT_INTERVAL  # simulated s, --every
    resume: Path | None = None
    effect_files: tuple[Path, ...] = ()  # effects from outside the package
    progress: Report | None = None
