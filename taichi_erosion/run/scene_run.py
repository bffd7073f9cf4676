"""Ctrl-C, termination and a closed terminal are heard between checks, where device and play agree.

A signal that the program was started to ignore, as `nohup` and background jobs have it, stays ignored.

Running a scene file: everything between the command line and the result document.
"""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.core.files import check_writable
from taichi_erosion.core.setup import Numerics
from taichi_erosion.effects import load_library
from taichi_erosion.measures.result import as_record
from taichi_erosion.measures.threshold import pool_beds
from taichi_erosion.recording import stream
from taichi_erosion.recording.checkpoint import load_checkpoint
from taichi_erosion.run.checks import read_scene
from taichi_erosion.run.ensemble_loop import Play, play
from taichi_erosion.run.instrument_response import as_read
from taichi_erosion.run.options import RunOptions
from taichi_erosion.run.recorder import (
    Camera,
    Keeper,
    Teller,
    finish_or_warn,
    open_camera,
    save_when_due,
    watch_while_there_is_room,
    whole_intervals,
)
from taichi_erosion.run.result import replica_record, versions, write_document
from taichi_erosion.run.resume import recall, seeds_of
from taichi_erosion.run.stages import Actor, sentence
from taichi_erosion.scene import Scene, explain, laws, resolved, scene_hash
from taichi_erosion.simulation import assemble, effective_scene, import_state, prepare

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@dataclass
class Interruption:
    """Signals that have arrived; a second one is not waited for."""

    arrived: list[int] = field(default_factory=list)

    def note(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal: remember the first, obey the second at once."""
        self.arrived.append(number)
        if len(self.arrived) > 1:
            self.obey()

    def obey(self) -> None:
        """Raise what the first signal stands for, if one has arrived."""
        if self.arrived:
            raise KeyboardInterrupt if self.arrived[0] == signal.SIGINT else SystemExit(128 + self.arrived[0])


@contextmanager
def deferred() -> Iterator[Interruption]:
    """Collect signals instead of obeying them; only the main thread may ask for signals."""
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return
    heeded = [number for number in SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, interruption.note) for number in heeded}
    try:
        yield interruption
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


FOLDER = Path("recordings")  # where results go unless the user names a file
SURFACE_ENERGY_CONVENTION = "energy per surface: work of adhesion w = 2 gamma, JKR pull-off 3 pi gamma R*"


def run_scene(path: Path, options: RunOptions) -> dict[str, Any]:
    """Simulate, measure and record a scene; returns the document of `run --json`.

    Raises BadInput before anything is written, SimulationStopped when no replica came to its end, and
    KeyboardInterrupt with a note of what was kept.
    """
    started = time.perf_counter()
    scene = read_scene(path, orders_of(options), options.effect_files)
    hashed = scene_hash(scene)
    record = options.record or FOLDER / f"{path.stem}-{hashed}-{scene.run.seed}.rrd"
    seeds = [scene.run.seed + k for k in range(scene.run.replicas)]
    resume = load_checkpoint(options.resume, hashed) if options.resume else None
    if resume and seeds_of(resume[1]) != seeds:
        raise BadInput(f"{options.resume}: holds seeds {seeds_of(resume[1])}, not {seeds}")
    numerics = Numerics(options.arch, options.threads, scene.run.precision)
    library = load_library(options.effect_files) if scene.effects else {}
    setups = [prepare(scene, seed, library) for seed in seeds]
    refuse_places(path, options, record)
    sim = assemble(setups, laws(effective_scene(scene, library)), numerics)
    stage_play = Play([effective_scene(scene, library)] * len(seeds), sim, [Actor(seed) for seed in seeds])
    if resume:
        import_state(sim, resume[0])
        recall(stage_play, *resume)
    camera = None
    if not options.no_record:
        title = f"{scene.scene.title or path.stem}, seed {seeds[0]}"
        camera = open_camera(record, title, stage_play, scene_text(path, options.overrides))
    keeper = keeper_of(options, record, hashed, stage_play.time)
    perform(stage_play, camera, keeper, options)
    with deferred():  # a signal that comes now finds everything written
        for actor in stage_play.actors:
            actor.measurements = as_read(actor.measurements, scene, library)
        document = describe(path, scene, stage_play, time.perf_counter() - started)
        if camera:
            keep(camera, stage_play, document)
    stop_if_none_left(stage_play)
    return document


def refuse_places(path: Path, options: RunOptions, record: Path) -> None:
    """Raise BadInput where a file cannot be written, or would replace the scene."""
    for place in places(options, record):
        check_writable(place)
        if place.exists() and place.samefile(path):
            raise BadInput(f"{place}: is the scene itself; give another name to what is written")


def places(options: RunOptions, record: Path) -> list[Path]:
    """Files that will be written."""
    asked = [] if options.checkpoint is None else [options.checkpoint]
    return asked if options.no_record else [*asked, record]


def keep(camera: Camera, stage_play: Play, document: dict[str, Any]) -> None:
    """Finish the recording and write the document beside it; what the disk refuses becomes a warning."""
    first = document["replicas"][0]
    document |= finish_or_warn(camera, stage_play, first, {"scene": {"hash": document["hash"]}})
    try:
        write_document(camera.recording.path.with_suffix(".json"), document)
    except BadInput as error:
        first["warnings"].insert(0, str(error))


def scene_text(path: Path, overrides: tuple[str, ...]) -> str:
    """The scene file as it was run: what was changed for this run stands above it."""
    changes = "".join(f"# --set {override}\n" for override in overrides)
    return changes + path.read_text(encoding="utf-8")


def orders_of(options: RunOptions) -> tuple[str, ...]:
    """Changes of the scene, with what the command line says about repeats and precision."""
    words = {"seed": options.seed, "replicas": options.replicas, "precision": options.precision}
    said = [f"run.{name}={value}" for name, value in words.items() if value is not None]
    return (*options.overrides, *said)


def keeper_of(options: RunOptions, record: Path, hashed: str, time: float) -> Keeper:
    """Checkpoints as asked for, from a time on; without words only an interruption leaves one."""
    path = options.checkpoint or record.with_suffix(".checkpoint.npz")
    interval = options.every or float("inf")
    return Keeper(path, interval, {"scene_hash": hashed}, kept=whole_intervals(time, interval))


def perform(stage_play: Play, camera: Camera | None, keeper: Keeper, options: RunOptions) -> None:
    """Play with all watchers; on Ctrl-C close the recording and keep a checkpoint."""
    watchers: list[Callable[[Play], None]] = [partial(watch_while_there_is_room, camera)] if camera else []
    if options.checkpoint and options.every:
        watchers.append(partial(save_when_due, keeper))
    if options.progress:
        watchers.append(Teller(options.progress).watch)
    try:
        with deferred() as interruption:
            play(stage_play, [*watchers, lambda _: interruption.obey()])
    except (KeyboardInterrupt, SystemExit) as signal:
        keeper.save(stage_play)
        kept = f"recording {stream.close(camera.recording)}; " if camera else ""
        if isinstance(signal, KeyboardInterrupt):
            signal.args = (f"{kept}checkpoint {keeper.path}",)
        raise
    except BaseException:
        if camera:
            stream.close(camera.recording)
        raise
    if options.checkpoint and not options.every:
        keeper.save(stage_play)


def describe(path: Path, scene: Scene, stage_play: Play, seconds: float) -> dict[str, Any]:
    """The result document of DESIGN: per replica, pooled, measured, cost, versions."""
    sim = stage_play.sim
    replicas = [replica_record(stage_play, replica) for replica in range(len(stage_play.actors))]
    measured = [actor.measurements for actor in stage_play.actors]
    names = dict.fromkeys(name for found in measured for name in found)
    pooled = {
        name: as_record(pool_beds([found[name] for found in measured if name in found])) for name in names
    }
    return {
        "scene": str(path),
        "title": scene.scene.title,
        "hash": scene_hash(scene),
        "seed": scene.run.seed,
        "replicas": replicas,
        "measures": pooled,
        "measured": {name: m.model_dump() for name, m in scene.measured.items()},
        "grain_steps": round(stage_play.grain_steps),
        "wall_s": seconds,
        "recording": None,
        "numerics": {"arch": sim.numerics.arch, "threads": sim.workers, "precision": sim.numerics.precision},
        "limits": explain(scene),
        "restitution": {
            i.pair: {"stated": i.stated, "found": i.found} for i in stage_play.impacts if i.replica == 0
        },
        "convention": SURFACE_ENERGY_CONVENTION,
        "resolved": resolved(scene),
        "versions": versions(),
    }


def stop_if_none_left(stage_play: Play) -> None:
    """Raise SimulationStopped when every replica failed."""
    failed = [actor for actor in stage_play.actors if actor.failure is not None]
    if len(failed) == len(stage_play.actors):
        first = failed[0]
        assert first.failure is not None
        more = f" (and {len(failed) - 1} more replicas stopped)" if len(failed) > 1 else ""
        raise SimulationStopped(sentence(first.failure, first.seed) + more)
