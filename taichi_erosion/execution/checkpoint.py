"""Checkpoints of a run (`--checkpoint FILE --every T`), and what `--resume FILE` restores beside the device.

A resumed run ends bit for bit as one that was never interrupted, wherever in a stage that was. Of every
replica the checkpoint holds its whole state: frames and air profiles of the stage so far, the bed at rest of
a search for thresholds, and its trial under way. The file is whole or not there, and read back bit for bit.

A restart changes the set-up: some entries may change while the grains stay, and the state follows.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from taichi_erosion import simulation
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.snapshot import AirProfile, Failure, Snapshot, Status
from taichi_erosion.core.transfer import download
from taichi_erosion.execution.ensemble_loop import EnsembleRun
from taichi_erosion.execution.stages import ReplicaState, begin_stage, count_whole_intervals
from taichi_erosion.execution.threshold_search import ThresholdSearch, Trial
from taichi_erosion.measures.result import Measurement, json_value
from taichi_erosion.measures.threshold import Bracket
from taichi_erosion.scene import Scene, resolve
from taichi_erosion.scene.checkpoint_file import Arrays, save_checkpoint
from taichi_erosion.scene.paths import leaf_entries
from taichi_erosion.simulation import export_state
from taichi_erosion.simulation.saved_state import SURFACE

ARRAY = "array"  # key under which a record names an array of the checkpoint
MEASUREMENTS = TypeAdapter(dict[str, Measurement])
FREE = ("contact", "geometry", "gravity", "conditions", "effects", "measured", "record", "scene", "threshold")
WORDS = "contacts, walls, gravity, effects, measures, wind.friction_velocity and stages to come"
WIND = "wind.friction_velocity"
OF_ENDS = ("until", "duration_min", "duration_max", "rest_energy", "rest_contact_share")  # of a begun stage
LISTED = {"contact", "geometry", "materials", "effects"}  # sections that lists of contacts depend on
COUNTERS = ("checks", "grain_steps", "wall_s")  # of an ensemble
MOST_TOLD = 3  # changes that a message names


@dataclass
class Checkpointer:
    """Writer of the checkpoints of a run; as a callback it saves whenever an interval is over."""

    path: Path
    interval: float  # simulated s; infinite: one checkpoint, at the end or at an interruption
    meta: dict[str, Any]
    saved: int = 0  # intervals that have a checkpoint

    def __call__(self, ensemble: EnsembleRun) -> None:
        """Save when due; where that fails the checkpoint before stays, and the run goes on with a warning."""
        if (now := count_whole_intervals(ensemble.time, self.interval)) > self.saved:
            self.saved = now
            try:
                self.save_ensemble(ensemble)
            except BadInput as error:
                ensemble.states[0].warn(str(error))

    def save_ensemble(self, ensemble: EnsembleRun) -> None:
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
    replicas = json.loads(json.dumps(arrays_to_names(records, "run", arrays), default=json_value))
    counters = {name: getattr(ensemble, name) for name in COUNTERS}
    return arrays, counters | {"replicas": replicas}


def arrays_to_names(value: Any, name: str, arrays_out: Arrays) -> Any:
    """A nested value whose arrays are replaced by their names; they are collected in `arrays_out`."""
    if isinstance(value, np.ndarray):
        arrays_out[name] = value
        return {ARRAY: name}
    if isinstance(value, dict):
        return {key: arrays_to_names(entry, f"{name}.{key}", arrays_out) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [arrays_to_names(entry, f"{name}.{place}", arrays_out) for place, entry in enumerate(value)]
    return value


def replace_names_by_arrays(value: Any, arrays: Arrays) -> Any:
    """Inverse of `arrays_to_names`."""
    if isinstance(value, list):
        return [replace_names_by_arrays(entry, arrays) for entry in value]
    if not isinstance(value, dict):
        return value
    if value.keys() == {ARRAY}:
        return arrays[value[ARRAY]]
    return {key: replace_names_by_arrays(entry, arrays) for key, entry in value.items()}


def restore_run_state(ensemble: EnsembleRun, arrays: Arrays, meta: dict[str, Any]) -> None:
    """Inverse of `run_state`, into an ensemble of the same scenes."""
    for name in COUNTERS:
        setattr(ensemble, name, meta[name])
    records = replace_names_by_arrays(meta["replicas"], arrays)
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


def entries_that_differ(file: Path, scene: Scene, meta: Mapping[str, Any]) -> list[str]:
    """Entries of a scene, after its effects, that differ from those of a checkpoint. Raises BadInput.

    Refused is what would change the grains, their clock or what has already happened.
    """
    tables = meta.get("scene", {"stages": ()}), resolve(scene)
    old, new = (dict(leaf_entries({**table, "stages": dict(enumerate(table["stages"]))})) for table in tables)
    changed = [path for path in {**old, **new} if old.get(path, []) != new.get(path, [])]
    changed = [path for path in changed if path not in ("run.seed", "run.replicas")]
    stage = max(replica["stage"] - replica["finished"] for replica in meta["replicas"])
    wrong = [path for path in changed if not entry_may_differ(path, scene, stage)]
    if wrong or not changed:
        words = ", ".join(wrong[:MOST_TOLD]) or "an effect or a mesh"
        other = "fill = { law = 'bed', file = ... } begins a new run with its grains"
        raise BadInput(f"{file}: {words} differs from that of the checkpoint; {WORDS} may change; {other}")
    if all(replica["finished"] for replica in meta["replicas"]) and stage + 1 >= len(scene.stages):
        raise BadInput(f"{file}: all stages had ended; add one to the scene for what is to happen now")
    return changed


def entry_may_differ(path: str, scene: Scene, begun: int) -> bool:
    """Whether an entry may differ from that of a checkpoint in which the stage `begun` had begun."""
    section, *keys = path.split(".")
    if section == "materials":
        return keys[0] not in scene.grains.parts
    if section == "stages":  # tables of motions lie together on the device
        place = int(keys[0])
        return "table" not in keys and (place > begun or (place < len(scene.stages) and keys[1] in OF_ENDS))
    if section == "measure" and keys[-1] == "every":  # frames of a begun stage have its interval
        names = [stage.name for stage in scene.stages]
        stage_name = scene.measure[keys[0]].stage if keys[0] in scene.measure else None
        return names.index(stage_name or names[-1]) > begun
    return section in (*FREE, "measure") or path in (WIND, "domain.outside")


def adapt_state(ensemble: EnsembleRun, saved: Arrays, meta: Mapping[str, Any], changed: list[str]) -> Arrays:
    """State of a checkpoint for a changed scene.

    Contacts of grains keep their springs. Where walls differ, new ones stand as built, and contacts with all
    of them begin anew.
    """
    sections, state = {path.partition(".")[0] for path in changed}, dict(saved)
    for replica, setup in enumerate(ensemble.sim.setups):
        prefix = f"replica{replica}_"
        state[f"{prefix}material"] = setup.grains.material[state[f"{prefix}ident"].astype(int)]
        for name in [name for name in state if name.startswith(f"{prefix}wall_") and "geometry" in sections]:
            state[name] = 0 * state[name] if name.endswith("number") else state[name][:0]
    if sections & LISTED:
        state["stale"] = np.ones_like(state["stale"])
    walls = meta["scene"]["geometry"]
    return state | adapt_wall_state(ensemble, state, walls) if "geometry" in sections else state


def adapt_wall_state(ensemble: EnsembleRun, state: Arrays, before: Mapping[str, Any]) -> Arrays:
    """Walls as built; those that the checkpoint has too stand and move as there."""
    sim, after, adapted = ensemble.sim, resolve(ensemble.scenes[0])["geometry"], {}
    unchanged = [name for name in sorted(after) if before.get(name) == after[name]]
    rows = len(sim.setups) * sim.capacities.surfaces
    for name in SURFACE:
        values = adapted[f"surface_{name}"] = download([getattr(sim.world.walls, name)], 0, rows)[0]
        for replica, wall in np.ndindex(len(sim.setups), len(unchanged)):
            old, new = (len(each) * replica + sorted(each).index(unchanged[wall]) for each in (before, after))
            values[new] = state[f"surface_{name}"][old]
    return adapted


def apply_scene_changes(ensemble: EnsembleRun, changed: list[str]) -> None:
    """What follows from the changes for restored replicas: gravity, wind, stages after the last one."""
    sim, more = ensemble.sim, f" and {len(changed) - MOST_TOLD} more" if len(changed) > MOST_TOLD else ""
    for replica, (state, scene) in enumerate(zip(ensemble.states, ensemble.scenes, strict=True)):
        state.energy = None
        words = f"{', '.join(changed[:MOST_TOLD])}{more}"
        state.warn(f"until {ensemble.time:.6g} s the set-up was another one: {words}")
        if any(path.startswith("gravity") for path in changed):
            simulation.set_replica_gravity(sim, replica, sim.setups[replica].gravity)
        if scene.wind is not None and WIND in changed:
            simulation.spin_up_wind(sim, replica, scene.wind.friction_velocity)
        if state.finished and state.stage < len(scene.stages):
            state.finished, state.stage = False, state.stage - 1
            begin_stage(sim, scene, replica, state, ensemble.time)
