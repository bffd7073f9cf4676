"""Requests and results of runs, and the work of a campaign's worker: a batch is one ensemble on one thread.

A request is addressed by its content: the scene (with all that can change its result), the seed and the
version of this package make its key, and a key is never run twice in one ledger. With one thread per grain,
or on another device, forces are summed or rounded otherwise: heaps agree within the scatter of their seeds,
not in bits. Such runs have keys of their own: runs that are compared seed by seed must be made in one way.

On a graphics processor a batch is as many runs of one number of grains as it has room for.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from math import nan
from pathlib import Path
from typing import Any

from taichi_erosion import __version__
from taichi_erosion.campaign.study_file import WorkersEntry
from taichi_erosion.core.effect_file import EffectFile
from taichi_erosion.core.engine import engine_mark
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Arch, Numerics
from taichi_erosion.execution import checks
from taichi_erosion.scene import Scene, resolve, scene_hash
from taichi_erosion.scene.preparation.limits import time_step
from taichi_erosion.scene.preparation.sizes import spheres_of_clump

Payloads = Sequence[dict[str, Any]]
SendRecord = Callable[[int, dict[str, Any]], None]  # (place in the batch, record)
RunFunction = Callable[[Payloads, SendRecord], None]

WORTH_A_START = 4e7  # grain-steps that take as long as to start an ensemble: 10 M/s
START = 4.0  # s of one core that the start of an ensemble takes
THREADS = 1  # of a batch: it is one of several that run beside each other
RUNS_MOST = 64  # of a batch: more make an ensemble no cheaper to start, but its fields larger
DEVICE_GRAINS = 1_000_000  # of a batch on a graphics processor: some GB of its memory
CPU = WorkersEntry()


@dataclass(frozen=True)
class RunRequest:
    """One run; `payload` is what the run function receives, as JSON can hold it."""

    key: str  # same key, same result
    payload: dict[str, Any]
    group: str = ""  # requests of one group may go to one process as one ensemble
    work: float = WORTH_A_START  # grain-steps
    most: int = RUNS_MOST  # runs of a batch
    arch: Arch = "cpu"


@dataclass(frozen=True)
class RunResult:
    """What came out of one run; a run that failed is a result too, with its reason."""

    key: str
    record: dict[str, Any] = field(default_factory=dict)  # what the run function gave
    failure: str | None = None
    wall_s: float = 0.0

    def value(self, observable: str) -> float:
        """Measured value in the observable's unit, NaN where the run has none."""
        measure = self.record.get("measures", {}).get(observable, {}).get("value")
        return nan if measure is None else float(measure)


def request_of_file(
    path: Path, overrides: Sequence[str], seed: int, effect_files: checks.EffectFiles = (), **extra: Any
) -> RunRequest:
    """Request of one scene file with PATH=VALUE overrides and a seed. Raises BadInput for what cannot run.

    `extra` may be what `request_of_scene` takes beside: `device`, a study's [campaign]; `record` (file of a
    recording) and `properties` (columns of rerun's table of runs, by group), which change no result and are
    not in the key.
    """
    return request_of_scene(checks.read_scene(path, tuple(overrides), effect_files), seed, **extra)


def request_of_scene(
    scene: Scene,
    seed: int,
    record: Path | None = None,
    properties: Mapping[str, Mapping[str, Any]] | None = None,
    device: WorkersEntry = CPU,
) -> RunRequest:
    """Request of a scene that has been read. Raises BadInput for what the device cannot run.

    It carries the text of effect files: a worker elsewhere need not have them, and executes what was hashed.
    """
    numerics = scene_numerics(scene, device)
    payload = {
        "scene": resolve(scene),
        "folder": str(scene.folder.resolve()),
        "effect_files": [[str(file.path), file.text] for file in scene.effect_files_of_scene],
        "seed": seed,
        "record": None if record is None else str(record.resolve()),
        "properties": {group: dict(columns) for group, columns in (properties or {}).items()},
        "arch": numerics.arch,
        "decomposition": numerics.decomposition,
    }
    way = f"-{numerics.arch}-{'grains' if numerics.by_grain else 'partitions'}"
    mark = "" if way == "-cpu-partitions" else way  # of runs with bits of their own
    group = checks.compatibility_key(scene)
    key = f"{scene_hash(scene)}-{seed}-{__version__}{engine_mark()}{mark}"
    if numerics.arch == "cpu":
        return RunRequest(key, payload, group + mark, work_estimate(scene))
    grains = scene.grains.count
    most = max(DEVICE_GRAINS // grains, 1)
    return RunRequest(key, payload, f"{group}{mark}-{grains}", work_estimate(scene), most, numerics.arch)


def scene_numerics(scene: Scene, device: WorkersEntry) -> Numerics:
    """Device, precision and decomposition of a run. Raises BadInput for what cannot run there."""
    if device.arch == "cpu" and device.decomposition != "grains":  # and no compiler is imported
        return Numerics("cpu", THREADS, scene.run.precision, device.decomposition)
    from taichi_erosion.execution.scene_run import choose_device
    from taichi_erosion.simulation.capacities import refuse_thread_per_grain

    on_grid = scene.wind is not None and scene.wind.columns != (1, 1)
    # as many grains as a full batch has: the answer must not hang on how many runs wait
    arch = choose_device(device.arch, device.decomposition, RUNS_MOST * scene.grains.count, on_grid)
    numerics = Numerics(arch, THREADS, scene.run.precision, device.decomposition)
    refuse_thread_per_grain(grids=on_grid and numerics.by_grain)
    return numerics


def work_estimate(scene: Scene) -> float:
    """Most steps of contact spheres that a run of this scene can take, after its effects."""
    from taichi_erosion.simulation.scene_setup import effective_scene  # only here: it loads Taichi

    with suppress(BadInput):  # impossible with its effects: as without
        scene = effective_scene(scene, checks.library_of(scene))
    spheres = scene.grains.count * (len(spheres_of_clump(scene.grains.clump)) if scene.grains.clump else 1)
    return spheres * sum(stage.duration_max for stage in scene.stages) / time_step(scene)


@contextmanager
def simulation_function() -> Iterator[RunFunction]:
    """A run function for payloads of `request_of_scene`; ensembles take over the fields of those before."""
    from taichi_erosion.core.device import stop_device
    from taichi_erosion.core.effect_file import compile_failure_text
    from taichi_erosion.execution.ensemble import ReplicaRequest, run_replicas_reusing_buffers
    from taichi_erosion.scene.load import parse_scene
    from taichi_erosion.simulation import Simulation

    previous: Simulation | None = None

    def replica_request(payload: dict[str, Any]) -> ReplicaRequest:
        scene = parse_scene(payload["scene"], "scene of the campaign", Path(payload["folder"]))
        files = tuple(EffectFile(Path(path), text) for path, text in payload["effect_files"])
        scene = checks.attach_effects_to_scene(scene, files) if scene.effects else scene
        record = Path(payload["record"]) if payload["record"] else None
        return ReplicaRequest(scene, payload["seed"], record, payload["properties"])

    def simulate_batch(payloads: Payloads, send_record: SendRecord) -> None:
        nonlocal previous
        parts = [replica_request(payload) for payload in payloads]
        precision, way = parts[0].scene.run.precision, payloads[0]
        numerics = Numerics(way["arch"], THREADS, precision, way["decomposition"])
        before, previous = previous, None  # fields of an ensemble that breaks off are not used again
        try:
            previous = run_replicas_reusing_buffers(before, parts, numerics, send_record)
        except Exception as error:
            if (reason := compile_failure_text(error)) is None:
                raise
            raise BadInput(reason) from None

    yield simulate_batch
    stop_device()
