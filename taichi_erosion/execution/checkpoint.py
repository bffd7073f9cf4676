"""Checkpoints of a run (`--checkpoint FILE --every T`), and what `--resume FILE` restores beside the device.

A resumed run ends bit for bit as one that was never interrupted, wherever in a stage that was. Of every
replica the checkpoint holds its whole state: frames and air profiles of the stage so far, the bed at rest of
a search for thresholds, and its trial under way. The file is whole or not there, and read back bit for bit.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.snapshot import AirProfile, Failure, Snapshot, Status
from taichi_erosion.execution.ensemble_loop import EnsembleRun
from taichi_erosion.execution.stages import ReplicaState, whole_intervals
from taichi_erosion.execution.threshold_search import ThresholdSearch, Trial
from taichi_erosion.measures.result import Measurement, json_value
from taichi_erosion.measures.threshold import Bracket
from taichi_erosion.scene.checkpoint_file import Arrays, save_checkpoint
from taichi_erosion.simulation import export_state

ARRAY = "array"  # key under which a record names an array of the checkpoint
MEASUREMENTS = TypeAdapter(dict[str, Measurement])


@dataclass
class Checkpointer:
    """Writer of the checkpoints of a run; as a callback it saves whenever an interval is over."""

    path: Path
    interval: float  # simulated s; infinite: one checkpoint, at the end or at an interruption
    meta: dict[str, Any]
    saved: int = 0  # intervals that have a checkpoint

    def __call__(self, ensemble: EnsembleRun) -> None:
        """Save when due; where that fails the checkpoint before stays, and the run goes on with a warning."""
        if (now := whole_intervals(ensemble.time, self.interval)) > self.saved:
            self.saved = now
            try:
                self.save(ensemble)
            except BadInput as error:
                ensemble.states[0].warn(str(error))

    def save(self, ensemble: EnsembleRun) -> None:
        """Write device state and run state. Raises BadInput where the disk refuses."""
        arrays, meta = run_state(ensemble)
        save_checkpoint(self.path, export_state(ensemble.sim) | arrays, self.meta | meta)


def run_state(ensemble: EnsembleRun) -> tuple[Arrays, dict[str, Any]]:
    """Arrays of all replicas, and everything else as plain JSON values."""
    arrays: Arrays = {}
    records = [asdict(state) for state in ensemble.states]
    for record in records:
        if record["search"]:
            del record["search"]["scene"]
    replicas = json.loads(json.dumps(without_arrays(records, "run", arrays), default=json_value))
    return arrays, {"checks": ensemble.checks, "grain_steps": ensemble.grain_steps, "replicas": replicas}


def without_arrays(value: Any, name: str, arrays_out: Arrays) -> Any:
    """A nested value whose arrays are replaced by their names; they are collected in `arrays_out`."""
    if isinstance(value, np.ndarray):
        arrays_out[name] = value
        return {ARRAY: name}
    if isinstance(value, dict):
        return {key: without_arrays(entry, f"{name}.{key}", arrays_out) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_arrays(entry, f"{name}.{place}", arrays_out) for place, entry in enumerate(value)]
    return value


def with_arrays(value: Any, arrays: Arrays) -> Any:
    """Inverse of `without_arrays`."""
    if isinstance(value, list):
        return [with_arrays(entry, arrays) for entry in value]
    if not isinstance(value, dict):
        return value
    if value.keys() == {ARRAY}:
        return arrays[value[ARRAY]]
    return {key: with_arrays(entry, arrays) for key, entry in value.items()}


def restore_run(ensemble: EnsembleRun, arrays: Arrays, meta: dict[str, Any]) -> None:
    """Inverse of `run_state`, into an ensemble of the same scenes."""
    ensemble.checks, ensemble.grain_steps = meta["checks"], meta["grain_steps"]
    records = with_arrays(meta["replicas"], arrays)
    ensemble.states = [ReplicaState(**record) for record in records]
    for state, record, scene in zip(ensemble.states, records, ensemble.scenes, strict=True):
        if failed := record["failure"]:
            state.failure = Failure(**failed | {"status": Status(failed["status"])})
        state.measurements = MEASUREMENTS.validate_python(record["measurements"])
        state.frames = [Snapshot(**frame) for frame in record["frames"]]
        state.airs = [AirProfile(**air) for air in record["airs"]]
        if search := record["search"]:
            brackets = {name: Bracket(**each) for name, each in search["brackets"].items()}
            parts = {"trial": Trial(**search["trial"]), "brackets": brackets}
            state.search = ThresholdSearch(scene, **search | parts)
