"""Replicas of several scenes as one ensemble, each with a scene and a seed of its own.

A replica gives the same bits here as alone. All replicas share what is compiled into the kernels, and the
check interval; `checks.compatibility_key` is equal for scenes that may run together.
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
from taichi_erosion.execution.checks import library_of
from taichi_erosion.execution.ensemble_loop import EnsembleRun, run_ensemble
from taichi_erosion.execution.recorder import (
    Properties,
    Recorder,
    finish_recording,
    open_recorder,
    record_replica,
)
from taichi_erosion.execution.result import apply_instruments, replica_record, versions_of_dependencies
from taichi_erosion.execution.stages import ReplicaState
from taichi_erosion.scene import Scene, laws, resolve, scene_hash
from taichi_erosion.simulation import Simulation, effective_scene, prepare, reuse_or_assemble

OnResult = Callable[[int, dict[str, Any]], None]  # (index of the request, record of its replica)


@dataclass(frozen=True)
class ReplicaRequest:
    """Scene, seed and outputs of one replica."""

    scene: Scene
    seed: int
    record: Path | None = None  # recording file
    properties: Properties | None = None  # further columns of rerun's table of runs


def run_replicas(requests: Sequence[ReplicaRequest], numerics: Numerics, on_result: OnResult) -> None:
    """Run all replicas in one ensemble; `on_result` receives the record of each as soon as it has ended.

    A record holds seed, measures, warnings, `stopped`, hash, versions, `wall_s` and `cpu_s` (equal shares of
    the ensemble's) and `failure`: None, or the reason of a missing result. A replica that cannot start fails
    alone.
    """
    run_replicas_reusing_buffers(None, requests, numerics, on_result)
    stop_device()


def run_replicas_reusing_buffers(
    previous: Simulation | None, requests: Sequence[ReplicaRequest], numerics: Numerics, on_result: OnResult
) -> Simulation | None:
    """The same in the buffers of an ensemble that has ended; returns the simulation for the next one.

    The device keeps running: after the last ensemble the caller stops it.
    """
    library = library_of(*(request.scene for request in requests))
    setups: dict[int, Setup] = {}
    for index, request in enumerate(requests):
        try:
            setups[index] = prepare(request.scene, request.seed, library)
        except BadInput as error:
            on_result(index, record_of_refused_replica(request, str(error)))
    if not setups:
        return previous
    scenes = [effective_scene(requests[index].scene, library) for index in setups]
    try:
        sim = reuse_or_assemble(previous, list(setups.values()), laws(scenes[0]), numerics)
    except BadInput as error:
        for index in setups:
            if len(setups) == 1:
                on_result(index, record_of_refused_replica(requests[index], str(error)))
            else:
                run_replicas([requests[index]], numerics, lambda _, record, i=index: on_result(i, record))
        return None
    ready = {index: requests[index] for index in setups}
    ensemble = EnsembleRun(scenes, sim, [ReplicaState(request.seed) for request in ready.values()])
    reporter = ResultReporter(ready, library, on_result, open_recorders(list(ready.values()), ensemble))
    recording = [partial(record_replica, recorder) for recorder in reporter.recorders.values()]
    run_ensemble(ensemble, [*recording, reporter])
    return sim


def record_of_refused_replica(request: ReplicaRequest, reason: str) -> dict[str, Any]:
    empty = {"seed": request.seed, "measures": {}, "warnings": [], "removed": [], "time": 0.0}
    cost = {"wall_s": 0.0, "cpu_s": 0.0, "versions": versions_of_dependencies()}
    return empty | cost | {"hash": scene_hash(request.scene), "stopped": "refused", "failure": reason}


def open_recorders(requests: list[ReplicaRequest], ensemble: EnsembleRun) -> dict[int, Recorder]:
    """Recorders by replica; a recording that cannot be opened becomes a warning."""
    recorders = {}
    for replica, request in enumerate(requests):
        if request.record is None:
            continue
        scene = ensemble.scenes[replica]
        text = json.dumps(resolve(request.scene), indent=1)  # a run of a campaign has no scene file
        title = f"{scene.scene.title or scene.scene.kind or 'scene'}, seed {request.seed}"
        try:
            recorders[replica] = open_recorder(request.record, title, text, ensemble.sim, scene, replica)
        except BadInput as error:
            ensemble.states[replica].warn(str(error))
    return recorders


@dataclass
class ResultReporter:
    """Callback that reports the record of every replica once, at the check at which it ends."""

    ready: dict[int, ReplicaRequest]  # by index, in the order of the replicas
    library: dict[str, Effect]  # empty where no scene names an effect
    on_result: OnResult
    recorders: dict[int, Recorder]
    wall_start: float = field(default_factory=time.perf_counter)  # s
    cpu_start: float = field(default_factory=time.process_time)  # s
    reported: set[int] = field(default_factory=set)

    def __call__(self, ensemble: EnsembleRun) -> None:
        for replica, (index, request) in enumerate(self.ready.items()):
            if not ensemble.states[replica].active and replica not in self.reported:
                self.reported.add(replica)
                self.on_result(index, self.record(ensemble, replica, request))

    def record(self, ensemble: EnsembleRun, replica: int, request: ReplicaRequest) -> dict[str, Any]:
        """Record of one replica, its recording finished."""
        state = ensemble.states[replica]
        state.measurements = apply_instruments(state.measurements, request.scene, self.library)
        record = replica_record(ensemble, replica)
        recorder = self.recorders.get(replica)
        hashed = scene_hash(request.scene)
        if recorder is not None:
            properties = {"scene": {"hash": hashed}} | dict(request.properties or {})
            record |= finish_recording(recorder, ensemble, record, properties)
        failure = record["warnings"][-1] if record["stopped"] is not None else None
        count = len(self.ready)
        wall, cpu = time.perf_counter() - self.wall_start, time.process_time() - self.cpu_start
        cost = {"wall_s": wall / count, "cpu_s": cpu / count, "versions": versions_of_dependencies()}
        return record | cost | {"hash": hashed, "failure": failure}
