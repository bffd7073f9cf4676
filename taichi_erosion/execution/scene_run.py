"""Run of a scene of grains, from its file to the result document; signals, checkpoints and resumption."""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from math import isinf
from pathlib import Path
from types import FrameType
from typing import Any

from taichi_erosion.core.device import has_cuda
from taichi_erosion.core.effect import Effect
from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.core.setup import Arch, ArchChoice, Decomposition, Numerics
from taichi_erosion.execution import RunOptions, checkpoint, checks, ensemble_loop, result
from taichi_erosion.execution.ensemble_loop import run_ensemble
from taichi_erosion.execution.recorder import Recorder, finish_recording, open_recorder, record_replica
from taichi_erosion.execution.stages import ReplicaState, count_whole_intervals
from taichi_erosion.measures.threshold import pool_beds
from taichi_erosion.recording import stream
from taichi_erosion.scene import Scene, laws, resolve, scene_hash
from taichi_erosion.scene.checkpoint_file import load_checkpoint
from taichi_erosion.simulation import assemble, effective_scene, import_state, prepare
from taichi_erosion.simulation.capacities import has_grid, has_servo
from taichi_erosion.simulation.team import mean_team_size

CROSSOVER = 5_000  # grains of all replicas from which `auto` takes a graphics processor: docs/speed.md
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
SURFACE_ENERGY_CONVENTION = "energy per surface: work of adhesion w = 2 gamma, JKR pull-off 3 pi gamma R*"


@dataclass
class PendingSignals:
    """Signals that have arrived; the first waits for the next check, the second acts at once."""

    arrived: list[int] = field(default_factory=list)

    def note_signal(self, number: int, frame: FrameType | None) -> None:
        self.arrived.append(number)
        if len(self.arrived) > 1:
            self.raise_first_signal()

    def raise_first_signal(self) -> None:
        """Raise KeyboardInterrupt or SystemExit for the first signal, if one has arrived."""
        if self.arrived:
            raise KeyboardInterrupt if self.arrived[0] == signal.SIGINT else SystemExit(128 + self.arrived[0])


@contextmanager
def defer_signals() -> Iterator[PendingSignals]:
    """Collect signals, to be raised between checks, where device and run state agree.

    Only the main thread can handle signals; those that the program was started to ignore, as `nohup` and
    background jobs do, stay ignored.
    """
    pending = PendingSignals()
    if threading.current_thread() is not threading.main_thread():
        yield pending
        return
    handled = [number for number in SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, pending.note_signal) for number in handled}
    try:
        yield pending
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def run_scene(path: Path, options: RunOptions) -> dict[str, Any]:
    """Simulate, measure and record a scene; returns the document of `run --json`.

    Raises BadInput before anything is written, SimulationStopped where every replica failed, and
    KeyboardInterrupt with the names of the files that were written.
    """
    started = time.perf_counter()
    named = checks.read_effects(options.effect_files)
    words = {"seed": options.seed, "replicas": options.replicas, "precision": options.precision}
    numbers = [f"run.{name}={value}" for name, value in words.items() if value is not None]
    scene = checks.read_scene(path, (*options.overrides, *numbers), named)
    comparisons = checks.comparable(path, scene)  # now: the file may be another one when the run ends
    record = result.recording_path_of_run(path, scene, scene.run.seed, options)
    library = checks.library_of(scene)
    ensemble = assemble_run(path, scene, library, options, record)
    started -= ensemble.wall_s  # of the parts before a resume
    recorder = None
    if not options.no_record:
        title = f"{scene.scene.title or path.stem}, seed {scene.run.seed}"
        text = scene_text_with_overrides(path, options.overrides)
        recorder = open_recorder(record, title, text, ensemble.sim, ensemble.scenes[0], 0)
    checkpointer = checkpoint.Checkpointer(
        options.checkpoint or record.with_suffix(".checkpoint.npz"),
        options.checkpoint_interval,
        {"scene_hash": scene_hash(scene), "scene": resolve(ensemble.scenes[0])},
        count_whole_intervals(ensemble.time, options.checkpoint_interval),
    )
    run_with_outputs(ensemble, recorder, checkpointer, options)
    with defer_signals():  # a signal that comes now acts once everything is written
        for state in ensemble.states:
            state.measurements = result.apply_instruments(state.measurements, scene, library)
        limits = checks.setup_report(scene, named)
        document = grain_run_document(path, scene, ensemble, comparisons, limits, started)
        if recorder:
            first, properties = document["replicas"][0], {"scene": {"hash": scene_hash(scene)}}
            document |= finish_recording(recorder, ensemble, first, properties)
            result.write_document_or_warn(record, document)
    failed = [(state.failure, state.seed) for state in ensemble.states if state.failure is not None]
    if len(failed) == len(ensemble.states):
        more = f" (and {len(failed) - 1} more replicas stopped)" if len(failed) > 1 else ""
        raise SimulationStopped(ensemble_loop.failure_message(*failed[0]) + more)
    return document


def assemble_run(
    path: Path, scene: Scene, library: dict[str, Effect], options: RunOptions, record: Path
) -> ensemble_loop.EnsembleRun:
    """All replicas of a scene, at their beginning or where the checkpoint left them. Raises BadInput."""
    seeds = [scene.run.seed + k for k in range(scene.run.replicas)]
    resume, changed = load_checkpoint(options.resume) if options.resume else None, []
    if resume and (saved := [record["seed"] for record in resume[1]["replicas"]]) != seeds:
        raise BadInput(f"{options.resume}: holds seeds {saved}, not {seeds}")
    setups = [prepare(scene, seed, library) for seed in seeds]
    result.refuse_unwritable_outputs(path, options, record)
    effective = effective_scene(scene, library)
    if resume and options.resume and resume[1].get("scene_hash") != scene_hash(scene):
        changed = checkpoint.entries_that_differ(options.resume, effective, resume[1])
    grains = sum(len(setup.grains.radius) for setup in setups)
    arch = choose_device(options.arch, options.decomposition, grains, has_grid(setups) or has_servo(setups))
    numerics = Numerics(arch, options.threads, scene.run.precision, options.decomposition)
    sim = assemble(setups, laws(effective), numerics)
    states = [ReplicaState(seed) for seed in seeds]
    ensemble = ensemble_loop.EnsembleRun([effective] * len(seeds), sim, states, repeats=True)
    if resume:
        import_state(sim, checkpoint.adapt_state(ensemble, *resume, changed) if changed else resume[0])
        checkpoint.restore_run_state(ensemble, *resume)
        if changed:
            checkpoint.apply_scene_changes(ensemble, changed)
    return ensemble


def choose_device(arch: ArchChoice, decomposition: Decomposition | None, grains: int, on_grids: bool) -> Arch:
    """Device of a run; `auto` takes a graphics processor where there is one and replicas have grains enough.

    `on_grids`: with grids of air, which one thread per grain does not have.
    """
    if arch != "auto":
        return arch
    runs_there = has_cuda() and not (on_grids and decomposition != "partitions")
    return "cuda" if grains >= CROSSOVER and runs_there else "cpu"


def scene_text_with_overrides(path: Path, overrides: tuple[str, ...]) -> str:
    """The scene file, below comments with the overrides of this run."""
    return "".join(f"# --set {override}\n" for override in overrides) + path.read_text(encoding="utf-8")


def run_with_outputs(
    ensemble: ensemble_loop.EnsembleRun,
    recorder: Recorder | None,
    checkpointer: checkpoint.Checkpointer,
    options: RunOptions,
) -> None:
    """Run with recording, checkpoints and progress; on Ctrl-C close the recording and save a checkpoint."""
    callbacks: list[ensemble_loop.Callback] = [partial(record_replica, recorder)] if recorder else []
    if options.checkpoint:
        callbacks.append(checkpointer)
    if options.progress:
        callbacks.append(partial(ensemble_loop.report_progress, options.progress))
    try:
        with defer_signals() as pending:
            run_ensemble(ensemble, [*callbacks, lambda _: pending.raise_first_signal()])
    except (KeyboardInterrupt, SystemExit) as interruption:
        checkpointer.save_ensemble(ensemble)
        closed = f"recording {stream.close(recorder.recording)}; " if recorder else ""
        if isinstance(interruption, KeyboardInterrupt):
            interruption.args = (f"{closed}checkpoint {checkpointer.path}",)
        raise
    except BaseException:
        if recorder:
            stream.close(recorder.recording)
        raise
    if options.checkpoint and isinf(options.checkpoint_interval):
        checkpointer.save_ensemble(ensemble)


def grain_run_document(
    path: Path,
    scene: Scene,
    ensemble: ensemble_loop.EnsembleRun,
    comparisons: dict[str, Any],
    limits: dict[str, Any],
    started: float,
) -> dict[str, Any]:
    sim = ensemble.sim
    numerics = {"arch": sim.numerics.arch, "threads": sim.workers, "precision": sim.numerics.precision}
    numerics |= {"decomposition": "grains"} if sim.numerics.by_grain else {}
    measured = [state.measurements for state in ensemble.states]
    names = dict.fromkeys(name for measurements in measured for name in measurements)
    pooled = {name: pool_beds([bed[name] for bed in measured if name in bed]) for name in names}
    return result.run_document(
        path,
        scene,
        [result.replica_record(ensemble, replica) for replica in range(len(ensemble.states))],
        pooled,
        comparisons,
        grain_steps=round(ensemble.grain_steps),
        wall_s=time.perf_counter() - started,
        numerics=numerics | mean_team_size(sim.team),
        limits=limits,
        convention=SURFACE_ENERGY_CONVENTION,
        effect_digests=scene.effect_digests,
    )
