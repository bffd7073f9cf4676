"""What a run leaves: the record of every replica, and the document as a file beside the recording."""

import json
import platform
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from taichi_erosion import __version__
from taichi_erosion.core.files import write_atomic
from taichi_erosion.measures.result import as_record, without_nan
from taichi_erosion.run.ensemble_loop import Play
from taichi_erosion.run.stages import sentence


def replica_record(stage_play: Play, replica: int) -> dict[str, Any]:
    """What came out of one replica, as JSON can hold it."""
    actor, sim = stage_play.actors[replica], stage_play.sim
    step = int(sim.world.replicas.step[replica])
    return {
        "seed": actor.seed,
        "measures": {name: as_record(m) for name, m in actor.measurements.items()},
        "warnings": actor.warnings + ([sentence(actor.failure, actor.seed)] if actor.failure else []),
        "stopped": None if actor.failure is None else actor.failure.status.name.lower(),
        "time": step * sim.setups[replica].time_step,
    }


@cache
def versions() -> dict[str, str]:
    """Versions that a result depends on."""
    return {"taichi_erosion": __version__, "python": platform.python_version()} | {
        name: version(name) for name in ("taichi", "numpy", "scipy", "rerun-sdk")
    }


def write_document(path: Path, document: dict[str, Any]) -> None:
    """Write strict JSON; NaN, which JSON does not know, becomes null."""
    text = json.dumps(without_nan(document), indent=1, default=plain, allow_nan=False)
    write_atomic(path, (text + "\n").encode())


def plain(value: Any) -> Any:
    """A NumPy scalar or a path as JSON can hold it."""
    return str(value) if isinstance(value, Path) else value.item()
