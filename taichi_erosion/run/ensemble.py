"""Several scenes at once: replicas of one ensemble, each with its own scene and seed.

A replica gives the same bits here as alone. What is compiled into the kernels is shared by all, and so is the
interval of the checks: `choices.shared_choices` names it.
"""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.effect import Effect
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Numerics, Setup
from taichi_erosion.effects import load_library
from taichi_erosion.run.ensemble_loop import Play, play
from taichi_erosion.run.instrument_response import as_read
from taichi_erosion.run.options import Report
from taichi_erosion.run.recorder import (
    Camera,
    Properties,
    Teller,
    finish_or_warn,
    open_camera,
    watch_while_there_is_room,
)
from taichi_erosion.run.result import replica_record, versions
from taichi_erosion.run.stages import Actor
from taichi_erosion.scene import Scene, laws, resolved, scene_hash
from taichi_erosion.simulation import Simulation, effective_scene, prepare, reuse_or_assemble

Told = Callable[[int, dict[str, Any]], None]  # (place in the list, what came out)


@dataclass(frozen=True)
class Part:
    """One replica that is asked for."""

    scene: Scene
    seed: int
    record: Path | None = None  # where its recording goes
    properties: Properties | None = None  # further columns of rerun's table of runs


@dataclass(frozen=True)
class Cast:
    """The parts that can be played, with their places in the list that was asked for."""

    library: dict[str, Effect]  # empty where no scene names an effect
    places: list[int] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)
    setups: list[Setup] = field(default_factory=list)
    scenes: list[Scene] = field(default_factory=list)  # after the effects that change them


def play_ensemble(
    parts: Sequence[Part], numerics: Numerics, tell: Told, progress: Report | None = None
) -> None:
    """Play all parts together and tell what came out of each as soon as it has ended.

    What is told holds seed, measures, warnings, `stopped`, hash, versions, `wall_s` and `cpu_s` (equal
    shares of the ensemble's) and `failure`: None, or why there is no result. A part that cannot start fails
    alone.
    """
    play_after(None, parts, numerics, tell, progress)
    stop_device()


def play_after(
    before: Simulation | None,
    parts: Sequence[Part],
    numerics: Numerics,
    tell: Told,
    progress: Report | None = None,
) -> Simulation | None:
    """The same, in the fields of an ensemble that has ended; returns what the next one may take over.

    Whoever wants no other ensemble stops the device.
    """
    cast = able_to_start(parts, tell)
    if not cast.parts:
        return before
    try:
        sim = reuse_or_assemble(before, cast.setups, laws(cast.scenes[0]), numerics)
    except BadInput as error:
        if len(cast.parts) == 1:
            tell(cast.places[0], refused(cast.parts[0], str(error)))
            return None
        for place, part in zip(cast.places, cast.parts, strict=True):
            play_ensemble([part], numerics, lambda _, record, place=place: tell(place, record), progress)
        return None
    stage_play = Play(cast.scenes, sim, [Actor(part.seed) for part in cast.parts])
    crier = Crier(cast, tell, time.perf_counter(), time.process_time(), cameras_of(cast, stage_play))
    watchers = [partial(watch_while_there_is_room, camera) for camera in crier.cameras.values()]
    teller = [Teller(progress).watch] if progress else []
    play(stage_play, [*watchers, *teller, crier.watch])
    return sim


def able_to_start(parts: Sequence[Part], tell: Told) -> Cast:
    """Build every replica; a part that cannot be built is told as failed."""
    cast = Cast(load_library() if any(part.scene.effects for part in parts) else {})
    for place, part in enumerate(parts):
        try:
            setup = prepare(part.scene, part.seed, cast.library)
        except BadInput as error:
            tell(place, refused(part, str(error)))
            continue
        cast.places.append(place)
        cast.parts.append(part)
        cast.setups.append(setup)
        cast.scenes.append(effective_scene(part.scene, cast.library))
    return cast


def refused(part: Part, reason: str) -> dict[str, Any]:
    """Record of a part that could not start."""
    found = {"seed": part.seed, "measures": {}, "warnings": [], "stopped": "refused", "time": 0.0}
    return found | {
        "hash": scene_hash(part.scene),
        "failure": reason,
        "wall_s": 0.0,
        "cpu_s": 0.0,
        "versions": versions(),
    }


def cameras_of(cast: Cast, stage_play: Play) -> dict[int, Camera]:
    """A camera for every replica that is to be recorded; one that cannot write costs no result."""
    cameras = {}
    for replica, part in enumerate(cast.parts):
        if part.record is None:
            continue
        try:
            text = scene_text(part.scene)
            cameras[replica] = open_camera(part.record, title_of(part), stage_play, text, replica)
        except BadInput as error:
            stage_play.actors[replica].warnings.append(str(error))
    return cameras


def title_of(part: Part) -> str:
    """Name of a recording."""
    return f"{part.scene.scene.title or part.scene.scene.kind}, seed {part.seed}"


def scene_text(scene: Scene) -> str:
    """The resolved scene for the recording; a campaign has no scene file of its own for every run."""
    return json.dumps(resolved(scene), indent=1)


@dataclass
class Crier:
    """Tells what came out of every replica, once, at the check at which it ends."""

    cast: Cast
    tell: Told
    started: float  # s, of the wall clock
    spent: float  # s, of the processor
    cameras: dict[int, Camera]
    told: set[int] = field(default_factory=set)

    def watch(self, stage_play: Play) -> None:
        """Tell of replicas that have ended since the last check."""
        for replica, actor in enumerate(stage_play.actors):
            if not actor.active and replica not in self.told:
                self.told.add(replica)
                self.tell(self.cast.places[replica], self.record(stage_play, replica))

    def record(self, stage_play: Play, replica: int) -> dict[str, Any]:
        """What came out of one replica."""
        part, actor = self.cast.parts[replica], stage_play.actors[replica]
        actor.measurements = as_read(actor.measurements, part.scene, self.cast.library)
        found = replica_record(stage_play, replica)
        camera = self.cameras.get(replica)
        hashed = scene_hash(part.scene)
        if camera is not None:
            properties = {"scene": {"hash": hashed}} | dict(part.properties or {})
            found |= finish_or_warn(camera, stage_play, found, properties)
        failed = found["stopped"] is not None
        count = len(self.cast.parts)
        seconds, spent = time.perf_counter() - self.started, time.process_time() - self.spent
        cost = {"wall_s": seconds / count, "cpu_s": spent / count, "versions": versions()}
        return found | cost | {"hash": hashed, "failure": found["warnings"][-1] if failed else None}
