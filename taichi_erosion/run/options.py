"""What a user may ask of a run beside its scene."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Report = Callable[[float, str], None]  # (share done [1], words)


@dataclass(frozen=True)
class RunOptions:
    """Words of `run`; None leaves a choice to the scene."""

    overrides: tuple[str, ...] = ()
    seed: int | None = None
    replicas: int | None = None
    arch: Literal["cpu", "cuda"] = "cpu"
    threads: int = 0
    precision: Literal["f32", "f64"] | None = None
    record: Path | None = None
    no_record: bool = False
    checkpoint: Path | None = None
    every: float | None = None  # simulated s between checkpoints
    resume: Path | None = None
    effect_files: tuple[Path, ...] = ()  # effects from outside the package
    progress: Report | None = None
