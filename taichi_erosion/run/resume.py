"""State of a run beside that of the device: written to checkpoints, restored by `--resume FILE`.

A resumed run ends bit for bit as one that was never interrupted.
"""

import json
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.snapshot import Failure, Snapshot, Status
from taichi_erosion.measures.result import Measurement
from taichi_erosion.run.ensemble_loop import EnsembleRun
from taichi_erosion.run.result import plain
from taichi_erosion.run.stages import ReplicaState

Arrays = dict[str, NDArray[Any]]

# the keys below and "actor" are part of the layout of a checkpoint
PLAIN_FIELDS = ("seed", "stage", "began", "finished", "energy", "released", "tilts", "warnings")
GRAIN_COLUMNS = ("position", "velocity", "spin", "radius", "mass", "contacts", "ident")  # of a Snapshot
TIME_COLUMNS = ("time", "step", "waiting")  # of a Snapshot


def run_state(ensemble: EnsembleRun) -> tuple[Arrays, dict[str, Any]]:
    """Frames as arrays, everything else as plain JSON values."""
    arrays = {
        f"actor{replica}_{name}": values
        for replica, state in enumerate(ensemble.states)
        for name, values in pack_frames(state.frames).items()
    }
    records = [json.loads(json.dumps(state_record(state), default=plain)) for state in ensemble.states]
    return arrays, {"checks": ensemble.checks, "grain_steps": ensemble.grain_steps, "actors": records}


def restore_run(ensemble: EnsembleRun, arrays: Arrays, meta: dict[str, Any]) -> None:
    """Inverse of `run_state`, into an ensemble of the same scenes."""
    ensemble.checks, ensemble.grain_steps = meta["checks"], meta["grain_steps"]
    for replica, (state, record) in enumerate(zip(ensemble.states, meta["actors"], strict=True)):
        prefix = f"actor{replica}_"
        columns = {k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)}
        restore_replica(state, record, unpack_frames(columns))


def seeds_of(meta: dict[str, Any]) -> list[int]:
    return [record["seed"] for record in meta["actors"]]


def state_record(state: ReplicaState) -> dict[str, Any]:
    """One replica without its frames."""
    failed = None if state.failure is None else asdict(state.failure)
    measured = {name: asdict(measurement) for name, measurement in state.measurements.items()}
    plain_fields = {name: getattr(state, name) for name in PLAIN_FIELDS}
    return plain_fields | {"failure": failed, "measurements": measured}


def restore_replica(state_out: ReplicaState, record: dict[str, Any], frames: list[Snapshot]) -> None:
    """Inverse of `state_record`."""
    for name in PLAIN_FIELDS:
        setattr(state_out, name, record[name])
    failed = record["failure"]
    state_out.failure = failed and Failure(**failed | {"status": Status(failed["status"])})
    state_out.measurements = {
        name: Measurement(**fields | {"notes": tuple(fields["notes"])})
        for name, fields in record["measurements"].items()
    }
    state_out.frames = frames


def pack_frames(frames: list[Snapshot]) -> Arrays:
    """All frames end to end, one array a column, with the grain count of each."""
    if not frames:
        return {}
    rows = {name: np.concatenate([getattr(frame, name) for frame in frames]) for name in GRAIN_COLUMNS}
    times = {name: np.array([getattr(frame, name) for frame in frames]) for name in TIME_COLUMNS}
    return rows | times | {"grains": np.array([len(frame.radius) for frame in frames])}


def unpack_frames(columns: Arrays) -> list[Snapshot]:
    """Inverse of `pack_frames`."""
    if not columns:
        return []
    cuts = np.cumsum(columns["grains"])[:-1]
    rows = zip(*(np.split(columns[name], cuts) for name in GRAIN_COLUMNS), strict=True)
    times = zip(*(columns[name].tolist() for name in TIME_COLUMNS), strict=True)
    return [
        Snapshot(**dict(zip(GRAIN_COLUMNS, row, strict=True)), **dict(zip(TIME_COLUMNS, values, strict=True)))
        for row, values in zip(rows, times, strict=True)
    ]
