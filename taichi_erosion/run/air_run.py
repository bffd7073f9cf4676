"""Running an air scene: from its file to the result document, measures and recording."""

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taichi_erosion.air.assemble import allocate_air
from taichi_erosion.air.column import advance_columns
from taichi_erosion.air.grid import Air
from taichi_erosion.air.readback import air_snapshot
from taichi_erosion.air.step import advance_air
from taichi_erosion.core.device import start_device
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.snapshot import AirSnapshot
from taichi_erosion.measures.boundary_layer import AirEvidence
from taichi_erosion.measures.result import as_record, pool
from taichi_erosion.recording import stream
from taichi_erosion.recording.air_recording import WindHeader, log_wind, open_wind_recording
from taichi_erosion.run.checks import AIR_OBSERVABLES, read_air_scene
from taichi_erosion.run.options import RunOptions
from taichi_erosion.run.result import versions, write_document
from taichi_erosion.run.scene_run import deferred
from taichi_erosion.scene.air_scene import air_hash, build_air, resolved_air
from taichi_erosion.scene.schema.air import AirScene

FOLDER = Path("recordings")  # where results go unless the user names a file
CURVES = {
    "speed_largest": "largest speed, m/s",
    "friction_velocity": "friction velocity of the floor, m/s",
    "iterations": "iterations of a pressure solve",
}


@dataclass
class Flow:
    """An ensemble of flows being followed."""

    scene: AirScene
    air: Air
    seeds: list[int]
    step_length: float  # s
    steps: int = 0
    iterations: int = 0
    kept: list[list[AirSnapshot]] = field(default_factory=list)  # states for the measures, by replica


def run_air_scene(path: Path, options: RunOptions) -> dict[str, Any]:
    """Simulate, measure and record a flow; returns the document of `run --json`.

    Raises BadInput before anything is written, SimulationStopped where the flow blows up.
    """
    started = time.perf_counter()
    refuse_words(options)
    scene = read_air_scene(path, options.overrides)
    first = scene.run.seed if options.seed is None else options.seed
    seeds = [first + k for k in range(options.replicas or 1)]
    setups = [build_air(scene, seed) for seed in seeds]
    threads = start_device(Numerics(options.arch, options.threads, "f64"))
    flow = Flow(scene, allocate_air(setups), seeds, setups[0].time_step)
    hashed = air_hash(scene)
    record = options.record or FOLDER / f"{path.stem}-{hashed}-{first}.rrd"
    recording = None if options.no_record else begin_recording(path, record, scene)
    try:
        with deferred() as interruption:
            follow(flow, recording, options, interruption.obey)
    except BaseException:
        if recording:
            stream.close(recording)
        raise
    document = describe(path, flow, threads, time.perf_counter() - started)
    if recording:
        keep(recording, document)
    return document


def keep(recording: stream.Recording, document: dict[str, Any]) -> None:
    """Finish the recording and write the document beside it; what the disk refuses becomes a warning."""
    try:
        finish(recording, document)
        document["recording"] = str(recording.path)
        write_document(recording.path.with_suffix(".json"), document)
    except BadInput as error:
        document["replicas"][0]["warnings"].insert(0, str(error))


def refuse_words(options: RunOptions) -> None:
    """Raise BadInput for words that a flow of air does not know."""
    if options.checkpoint or options.resume:
        raise BadInput("--checkpoint and --resume: scenes of air alone start anew each time")
    if options.precision == "f32":
        raise BadInput("--precision f32: air is always followed in f64")


def begin_recording(path: Path, record: Path, scene: AirScene) -> stream.Recording:
    """Open the recording of the first replica."""
    header = WindHeader(record.stem, scene.scene.title or path.stem, path.read_text(encoding="utf-8"), CURVES)
    return open_wind_recording(record, header)


def advance_flow(flow: Flow, steps: int) -> None:
    """Advance all replicas; a column alone stays on the device."""
    if flow.air.is_column and flow.air.model.scheme == "euler":
        advance_columns(steps, flow.air)
    else:
        flow.iterations += advance_air(flow.air, steps)
    flow.steps += steps


def follow(flow: Flow, recording: stream.Recording | None, options: RunOptions, obey: Any) -> None:
    """Run to the end, frame by frame; the last part of the run is kept for the measures."""
    run = flow.scene.run
    total = max(round(run.duration / flow.step_length), 1)
    flow.kept = [[] for _ in flow.seeds]
    for frame in range(1, run.frames + 1):
        steps = total * frame // run.frames - flow.steps
        before = flow.iterations
        if steps:
            advance_flow(flow, steps)
        obey()
        states = [air_snapshot(flow.air, replica) for replica in range(len(flow.seeds))]
        if frame > run.frames * (1.0 - run.averaging) or frame == run.frames:
            for kept, state in zip(flow.kept, states, strict=True):
                kept.append(state)
        if recording and steps:
            log_wind(
                recording, states[0], flow.steps, curves_of(states[0], (flow.iterations - before) / steps)
            )
        if options.progress:
            options.progress(frame / run.frames, f"{states[0].time:.3g} s simulated")


def curves_of(state: AirSnapshot, iterations: float) -> dict[str, float]:
    """Values of CURVES; a step of three stages solves for the pressure three times."""
    return {
        "speed_largest": float(abs(state.velocity).max()),
        "friction_velocity": float(state.friction_velocity.mean()),
        "iterations": iterations,
    }


def describe(path: Path, flow: Flow, threads: int, seconds: float) -> dict[str, Any]:
    """The result document of DESIGN."""
    scene = flow.scene
    measured = [measures_of(scene, states) for states in flow.kept]
    cells = len(flow.seeds) * flow.air.cells[0] * flow.air.cells[1] * flow.air.cells[2]
    replicas = [
        {
            "seed": seed,
            "measures": {name: as_record(m) for name, m in measurements.items()},
            "warnings": [],
            "stopped": None,
            "time": flow.steps * flow.step_length,
        }
        for seed, measurements in zip(flow.seeds, measured, strict=True)
    ]
    return {
        "scene": str(path),
        "title": scene.scene.title,
        "hash": air_hash(scene),
        "seed": flow.seeds[0],
        "replicas": replicas,
        "measures": {name: as_record(pool([m[name] for m in measured])) for name in scene.measure},
        "measured": {name: m.model_dump() for name, m in scene.measured.items()},
        "grain_steps": 0,
        "cell_steps": cells * flow.steps,
        "pressure_iterations_per_step": flow.iterations / max(flow.steps, 1),
        "wall_s": seconds,
        "recording": None,
        "numerics": {"threads": threads, "precision": "f64", "time_step": flow.step_length},
        "resolved": resolved_air(scene),
        "versions": versions(),
    }


def measures_of(scene: AirScene, states: list[AirSnapshot]) -> dict[str, Any]:
    """All measures of one replica."""
    return {
        name: AIR_OBSERVABLES[name](AirEvidence(states, order.place, scene.air.karman))
        for name, order in scene.measure.items()
    }


def finish(recording: stream.Recording, document: dict[str, Any]) -> None:
    """Properties of the run, then close the recording."""
    values = {name: record["value"] for name, record in document["measures"].items()}
    stream.set_properties(recording, "result", values)
    stream.set_properties(recording, "scene", {"hash": document["hash"], "seed": document["seed"]})
    stream.close(recording)
