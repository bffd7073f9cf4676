"""Checkpoints of a run (`--checkpoint FILE --every T`), and what `--resume FILE` restores beside the device.

A resumed run ends bit for bit as one that was never interrupted, wherever in a stage that was. Of every
replica the checkpoint holds its whole state: frames and air profiles of the stage so far, the bed at rest of
a search for thresholds, and its trial under way. The file is whole or not there, and read back bit for bit.
"""

import json
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from taichi_erosion import __version__
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import atomic_file, make_parent, regular_file
from taichi_erosion.core.snapshot import AirProfile, Failure, Snapshot, Status
from taichi_erosion.measures.result import Measurement, json_value
from taichi_erosion.measures.threshold import Bracket
from taichi_erosion.run.ensemble_loop import EnsembleRun
from taichi_erosion.run.stages import ReplicaState, whole_intervals
from taichi_erosion.run.threshold_search import ThresholdSearch, Trial
from taichi_erosion.simulation import export_state

Arrays = dict[str, NDArray[Any]]

# the number is raised when the layout of the file, or what a state holds, changes
SCHEMA = f"checkpoint 7 of taichi_erosion {__version__}"
HEAD = "head"  # member that holds the header
STATE = "state/"  # prefix of the members that hold the arrays
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
            trial, brackets = Trial(**search["trial"]), search["found"].items()
            found = {name: Bracket(**bracket) for name, bracket in brackets}
            state.search = ThresholdSearch(scene, **search | {"trial": trial, "found": found})


def save_checkpoint(path: Path, state: Arrays, meta: dict[str, Any]) -> None:
    """Write arrays and what belongs to them; `meta` holds what JSON can hold, `scene_hash` among it.

    The file grows beside its place, is forced to the disk, and then takes the place in one step: a crash at
    any moment leaves the previous checkpoint.
    """
    make_parent(path)
    head = json.dumps({"schema": SCHEMA, "meta": meta})
    members: Arrays = {HEAD: np.frombuffer(head.encode(), dtype=np.uint8)}
    members.update({STATE + name: values for name, values in state.items()})
    try:
        with atomic_file(path) as file:
            np.savez(file, allow_pickle=False, **members)
    except OSError as error:
        raise BadInput(f"{path}: the checkpoint cannot be written ({error.strerror})") from error


def is_checkpoint(path: Path) -> bool:
    """Whether a file is a checkpoint of this program, of any version."""
    try:
        with zipfile.ZipFile(regular_file(path)) as members:
            return f"{HEAD}.npy" in members.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def load_checkpoint(path: Path, scene_hash: str | None = None) -> tuple[Arrays, dict[str, Any]]:
    """Read (state, meta) of a checkpoint; with `scene_hash` only one of that scene.

    A run continues bit for bit only with the code that wrote it: another version of the package is refused.
    """
    try:
        with regular_file(path).open("rb") as file, np.load(file, allow_pickle=False) as members:
            head = json.loads(bytes(members[HEAD]).decode())
            schema, meta = head["schema"], dict(head["meta"])
            state = {name.removeprefix(STATE): members[name] for name in members.files if name != HEAD}
    except OSError as error:
        raise BadInput(f"{path}: the checkpoint cannot be read ({error.strerror or error})") from error
    except Exception as error:  # zip, zlib, numpy and JSON have an error each for what is damaged or foreign
        raise BadInput(f"{path}: damaged, or not a checkpoint of taichi_erosion") from error
    if schema != SCHEMA:
        raise BadInput(f"{path}: is '{schema}', which cannot be resumed as '{SCHEMA}'")
    if scene_hash not in (None, meta.get("scene_hash")):
        raise BadInput(f"{path}: belongs to scene {meta.get('scene_hash')}, not to {scene_hash}")
    return state, meta
