"""Checkpoints of a run (`--checkpoint FILE --every T`), and what `--resume FILE` restores beside the device.

A resumed run ends bit for bit as one that was never interrupted, wherever in a stage that was. Arrays of
replica r begin with `run{r}_`; among them are frames and air profiles of the stage so far, the bed at rest of
a search for thresholds, and its trial under way.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.snapshot import AirProfile, Failure, Snapshot, Status
from taichi_erosion.measures.result import Measurement, json_value
from taichi_erosion.measures.threshold import Bracket
from taichi_erosion.recording.checkpoint import save_checkpoint
from taichi_erosion.run.ensemble_loop import EnsembleRun
from taichi_erosion.run.stages import ROUNDING, ReplicaState, whole_intervals
from taichi_erosion.run.threshold_search import ThresholdSearch, Trial
from taichi_erosion.scene import Scene
from taichi_erosion.simulation import export_state

Arrays = dict[str, NDArray[Any]]

# the names below are part of the layout of a checkpoint
PLAIN_FIELDS = ("seed", "stage", "began", "finished", "energy", "released", "tilts", "warnings")
GRAIN_COLUMNS = ("position", "velocity", "spin", "radius", "mass", "contacts", "ident")  # of a Snapshot
TIME_COLUMNS = ("time", "step", "waiting")  # of a Snapshot
AIR_COLUMNS = ("face", "velocity", "void_fraction", "eddy_viscosity", "drag", "lift")  # of an AirProfile
SEARCH_FIELDS = ("phase", "low", "high", "flux_at_start", "trials")
TRIAL_FIELDS = ("friction_velocity", "began", "largest_motion", "flux")
TRIAL_COLUMNS = ("start", "last", "rolled", "risen")
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
        if ensemble.time >= (self.saved + 1) * self.interval * (1.0 - ROUNDING):
            self.saved = whole_intervals(ensemble.time, self.interval)
            try:
                self.save(ensemble)
            except BadInput as error:
                ensemble.states[0].warn(str(error))

    def save(self, ensemble: EnsembleRun) -> None:
        """Write device state and run state. Raises BadInput where the disk refuses."""
        arrays, meta = run_state(ensemble)
        save_checkpoint(self.path, export_state(ensemble.sim) | arrays, self.meta | meta)


def run_state(ensemble: EnsembleRun) -> tuple[Arrays, dict[str, Any]]:
    """What is as long as the grains or the air as arrays, everything else as plain JSON values."""
    arrays: Arrays = {}
    for replica, state in enumerate(ensemble.states):
        arrays |= prefixed(f"run{replica}_", state_arrays(state))
    records = [json.loads(json.dumps(state_record(state), default=json_value)) for state in ensemble.states]
    return arrays, {"checks": ensemble.checks, "grain_steps": ensemble.grain_steps, "replicas": records}


def restore_run(ensemble: EnsembleRun, arrays: Arrays, meta: dict[str, Any]) -> None:
    """Inverse of `run_state`, into an ensemble of the same scenes."""
    ensemble.checks, ensemble.grain_steps = meta["checks"], meta["grain_steps"]
    for replica, (state, record) in enumerate(zip(ensemble.states, meta["replicas"], strict=True)):
        restore_replica(state, record, without_prefix(f"run{replica}_", arrays), ensemble.scenes[replica])


def seeds_of(meta: dict[str, Any]) -> list[int]:
    return [record["seed"] for record in meta["replicas"]]


def prefixed(prefix: str, arrays: Arrays) -> Arrays:
    return {prefix + name: values for name, values in arrays.items()}


def without_prefix(prefix: str, arrays: Arrays) -> Arrays:
    """Those arrays whose names begin with the prefix, by the rest of their names."""
    return {name.removeprefix(prefix): values for name, values in arrays.items() if name.startswith(prefix)}


def state_arrays(state: ReplicaState) -> Arrays:
    """Frames, profiles of air and the arrays of the search of one replica."""
    arrays = prefixed("frame_", pack_frames(state.frames))
    if state.airs:
        arrays |= {f"air_{name}": np.stack([getattr(a, name) for a in state.airs]) for name in AIR_COLUMNS}
    if state.search is not None:
        arrays |= {f"trial_{name}": getattr(state.search.trial, name) for name in TRIAL_COLUMNS}
        arrays |= prefixed("bed_", state.search.bed)
    return arrays


def state_record(state: ReplicaState) -> dict[str, Any]:
    """One replica without its arrays."""
    failed = None if state.failure is None else asdict(state.failure)
    measured = {name: asdict(measurement) for name, measurement in state.measurements.items()}
    searched = None if state.search is None else search_record(state.search)
    plain_fields = {name: getattr(state, name) for name in PLAIN_FIELDS}
    return plain_fields | {"failure": failed, "measurements": measured, "search": searched}


def search_record(search: ThresholdSearch) -> dict[str, Any]:
    """The search without its arrays."""
    trial = {name: getattr(search.trial, name) for name in TRIAL_FIELDS}
    found = {name: asdict(bracket) for name, bracket in search.found.items()}
    return {name: getattr(search, name) for name in SEARCH_FIELDS} | {"found": found, "trial": trial}


def restore_replica(state_out: ReplicaState, record: dict[str, Any], arrays: Arrays, scene: Scene) -> None:
    """Inverse of `state_record` and `state_arrays`."""
    for name in PLAIN_FIELDS:
        setattr(state_out, name, record[name])
    failed = record["failure"]
    state_out.failure = failed and Failure(**failed | {"status": Status(failed["status"])})
    state_out.measurements = MEASUREMENTS.validate_python(record["measurements"])
    state_out.frames = unpack_frames(without_prefix("frame_", arrays))
    airs = without_prefix("air_", arrays)
    rows = zip(*(airs[name] for name in AIR_COLUMNS), strict=True) if airs else ()
    state_out.airs = [AirProfile(**dict(zip(AIR_COLUMNS, row, strict=True))) for row in rows]
    if search := record["search"]:  # inverse of `search_record`
        trial = Trial(**search["trial"] | without_prefix("trial_", arrays))
        found = {name: Bracket(**bracket) for name, bracket in search["found"].items()}
        again = {"bed": without_prefix("bed_", arrays), "trial": trial, "found": found}
        state_out.search = ThresholdSearch(scene, **search | again)


def pack_frames(frames: list[Snapshot]) -> Arrays:
    """All frames end to end, one array a column, with the grain count of each."""
    if not frames:
        return {}
    rows = {name: np.concatenate([getattr(frame, name) for frame in frames]) for name in GRAIN_COLUMNS}
    rows |= {
        f"effect_{name}": np.concatenate([frame.effect_state[name] for frame in frames])
        for name in frames[0].effect_state
    }
    times = {name: np.array([getattr(frame, name) for frame in frames]) for name in TIME_COLUMNS}
    return rows | times | {"grains": np.array([len(frame.radius) for frame in frames])}


def unpack_frames(columns: Arrays) -> list[Snapshot]:
    """Inverse of `pack_frames`."""
    if not columns:
        return []
    cuts = np.cumsum(columns["grains"])[:-1]
    values: dict[str, Any] = {name: np.split(columns[name], cuts) for name in GRAIN_COLUMNS}
    values |= {name: columns[name].tolist() for name in TIME_COLUMNS}
    effects = {name: np.split(v, cuts) for name, v in without_prefix("effect_", columns).items()}
    return [
        Snapshot(
            **{name: column[frame] for name, column in values.items()},
            effect_state={name: column[frame] for name, column in effects.items()},
        )
        for frame in range(len(columns["grains"]))
    ]
