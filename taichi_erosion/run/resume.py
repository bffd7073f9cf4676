"""What a play knows beside the state of the device, so that a resumed run ends as one that went through."""

import json
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.snapshot import Failure, Snapshot, Status
from taichi_erosion.measures.result import Measurement
from taichi_erosion.run.ensemble_loop import Play
from taichi_erosion.run.result import plain
from taichi_erosion.run.stages import Actor

Arrays = dict[str, NDArray[Any]]

PLAIN = ("seed", "stage", "began", "finished", "energy", "released", "tilts", "warnings")
GRAIN_ROWS = ("position", "velocity", "spin", "radius", "mass", "contacts", "ident")  # of a Snapshot
MOMENT = ("time", "step", "waiting")  # of a Snapshot


def remembered(stage_play: Play) -> tuple[Arrays, dict[str, Any]]:
    """Frames as arrays, everything else as JSON can hold it."""
    arrays = {
        f"actor{replica}_{name}": values
        for replica, actor in enumerate(stage_play.actors)
        for name, values in joined(actor.frames).items()
    }
    actors = [json.loads(json.dumps(actor_record(actor), default=plain)) for actor in stage_play.actors]
    return arrays, {"checks": stage_play.checks, "grain_steps": stage_play.grain_steps, "actors": actors}


def recall(stage_play: Play, arrays: Arrays, meta: dict[str, Any]) -> None:
    """Put the actors where the checkpoint left them."""
    stage_play.checks, stage_play.grain_steps = meta["checks"], meta["grain_steps"]
    for replica, (actor, record) in enumerate(zip(stage_play.actors, meta["actors"], strict=True)):
        prefix = f"actor{replica}_"
        frames = {k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)}
        restore(actor, record, split(frames))


def seeds_of(meta: dict[str, Any]) -> list[int]:
    """Seeds of the replicas in a checkpoint."""
    return [actor["seed"] for actor in meta["actors"]]


def actor_record(actor: Actor) -> dict[str, Any]:
    """One actor without its frames."""
    failed = None if actor.failure is None else asdict(actor.failure)
    measured = {name: asdict(measurement) for name, measurement in actor.measurements.items()}
    return {name: getattr(actor, name) for name in PLAIN} | {"failure": failed, "measurements": measured}


def restore(actor: Actor, record: dict[str, Any], frames: list[Snapshot]) -> None:
    """Give an actor back what `actor_record` noted."""
    for name in PLAIN:
        setattr(actor, name, record[name])
    failed = record["failure"]
    actor.failure = failed and Failure(**failed | {"status": Status(failed["status"])})
    actor.measurements = {
        name: Measurement(**noted | {"notes": tuple(noted["notes"])})
        for name, noted in record["measurements"].items()
    }
    actor.frames = frames


def joined(frames: list[Snapshot]) -> Arrays:
    """All frames in one array a column."""
    if not frames:
        return {}
    rows = {name: np.concatenate([getattr(frame, name) for frame in frames]) for name in GRAIN_ROWS}
    moments = {name: np.array([getattr(frame, name) for frame in frames]) for name in MOMENT}
    return rows | moments | {"grains": np.array([len(frame.radius) for frame in frames])}


def split(columns: Arrays) -> list[Snapshot]:
    """Frames from what `joined` made of them."""
    if not columns:
        return []
    cuts = np.cumsum(columns["grains"])[:-1]
    rows = zip(*(np.split(columns[name], cuts) for name in GRAIN_ROWS), strict=True)
    moments = zip(*(columns[name].tolist() for name in MOMENT), strict=True)
    return [
        Snapshot(**dict(zip(GRAIN_ROWS, row, strict=True)), **dict(zip(MOMENT, moment, strict=True)))
        for row, moment in zip(rows, moments, strict=True)
    ]
