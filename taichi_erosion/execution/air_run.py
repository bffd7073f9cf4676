"""Run of a scene of air alone, from its file to the result document, measures and recording."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taichi_erosion.air.grid import Air, allocate_air
from taichi_erosion.air.readback import air_snapshot
from taichi_erosion.air.single_column import advance_columns
from taichi_erosion.air.step import advance_air
from taichi_erosion.core.device import start_device
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.snapshot import AirSnapshot
from taichi_erosion.execution import RunOptions
from taichi_erosion.execution import result as results
from taichi_erosion.execution.checks import comparable
from taichi_erosion.execution.scene_run import defer_signals
from taichi_erosion.measures.boundary_layer import AIR_OBSERVABLES, AirMeasureInput
from taichi_erosion.measures.result import as_record, pool_repeats
from taichi_erosion.recording import stream
from taichi_erosion.recording.air_recording import log_wind, open_wind_recording
from taichi_erosion.scene.load import load_air_scene
from taichi_erosion.scene.preparation.air import build_air
from taichi_erosion.scene.schema.air import AirScene

CURVES = {
    "speed_largest": "largest speed, m/s",
    "friction_velocity": "friction velocity of the floor, m/s",
    "iterations": "iterations of a pressure solve",
}


@dataclass
class AirRun:
    """State of a run of an ensemble of flows."""

    scene: AirScene
    air: Air
    seeds: list[int]
    step_length: float  # s
    steps: int = 0
    iterations: int = 0  # of the pressure solver
    frames: list[list[AirSnapshot]] = field(default_factory=list)  # for the measures, by replica


def run_air_scene(path: Path, options: RunOptions) -> dict[str, Any]:
    """Simulate, measure and record a flow; returns the document of `run --json`.

    Raises BadInput before anything is written, SimulationStopped where the flow blows up.
    """
    started = time.perf_counter()
    if options.checkpoint or options.resume or options.precision == "f32":
        raise BadInput("--checkpoint, --resume, --precision f32: not for a scene of air alone")
    scene = load_air_scene(path, options.overrides, observables=tuple(AIR_OBSERVABLES))
    first = scene.run.seed if options.seed is None else options.seed
    seeds = [first + k for k in range(options.replicas or 1)]
    setups = [build_air(scene, seed) for seed in seeds]
    comparisons = comparable(path, scene)
    record = results.recording_path_of_run(path, scene, first, options)
    results.refuse_unwritable_outputs(path, options, record)
    arch = "cuda" if options.arch == "cuda" else "cpu"
    threads = start_device(Numerics(arch, options.threads, "f64"))
    run = AirRun(scene, allocate_air(setups), seeds, setups[0].time_step)
    recording = None
    if not options.no_record:
        text = path.read_text(encoding="utf-8")
        recording = open_wind_recording(record, scene.scene.title or path.stem, text, CURVES)
    try:
        with defer_signals() as pending:
            advance_air_to_end(run, recording, options, pending.raise_first_signal)
    except BaseException:
        if recording:
            stream.close(recording)
        raise
    document = air_run_document(path, run, comparisons, threads, time.perf_counter() - started)
    if recording:
        finish_air_recording(recording, document)
    return document


def advance_air_to_end(
    run: AirRun, recording: stream.Recording | None, options: RunOptions, check: Callable[[], None]
) -> None:
    """Advance frame by frame; frames of the averaging window are stored. `check` may raise after a frame."""
    settings = run.scene.run
    total = max(round(settings.duration / run.step_length), 1)
    run.frames = [[] for _ in run.seeds]
    for frame in range(1, settings.frames + 1):
        steps = total * frame // settings.frames - run.steps
        before = run.iterations
        if steps and run.air.is_column and run.air.model.scheme == "euler":
            advance_columns(steps, run.air)
        elif steps:
            run.iterations += advance_air(run.air, steps)
        run.steps += steps
        check()
        states = [air_snapshot(run.air, replica) for replica in range(len(run.seeds))]
        if frame > settings.frames * (1.0 - settings.averaging) or frame == settings.frames:
            for stored, state in zip(run.frames, states, strict=True):
                stored.append(state)
        if recording and steps:
            curves = {
                "speed_largest": float(abs(states[0].velocity).max()),
                "friction_velocity": float(states[0].friction_velocity.mean()),
                "iterations": (run.iterations - before) / steps,
            }
            log_wind(recording, states[0], run.steps, curves)
        if options.progress:
            options.progress(frame / settings.frames, f"{states[0].time:.3g} s simulated")


def air_run_document(
    path: Path, run: AirRun, comparisons: dict[str, Any], threads: int, seconds: float
) -> dict[str, Any]:
    scene = run.scene
    measured = []
    for frames in run.frames:
        inputs = {n: AirMeasureInput(frames, m.place, scene.air.karman) for n, m in scene.measure.items()}
        measured.append({name: AIR_OBSERVABLES[name](each) for name, each in inputs.items()})
    cells = run.air.cells[0] * run.air.cells[1] * run.air.cells[2]
    replicas = [
        {
            "seed": seed,
            "measures": {name: as_record(m) for name, m in measurements.items()},
            "warnings": [],
            "stopped": None,
            "time": run.steps * run.step_length,
        }
        for seed, measurements in zip(run.seeds, measured, strict=True)
    ]
    return results.run_document(
        path,
        scene,
        replicas,
        {name: pool_repeats([measurements[name] for measurements in measured]) for name in scene.measure},
        comparisons,
        grain_steps=0,
        cell_steps=len(run.seeds) * cells * run.steps,
        pressure_iterations_per_step=run.iterations / max(run.steps, 1),
        wall_s=seconds,
        numerics={"threads": threads, "precision": "f64", "time_step": run.step_length},
        limits={"warnings": []},
    )


def finish_air_recording(recording: stream.Recording, document: dict[str, Any]) -> None:
    """Write properties, close the recording, write the document beside it; disk errors become warnings."""
    result = {name: measured["value"] for name, measured in document["measures"].items()}
    scene = {"hash": document["hash"], "seed": document["seed"]}
    try:
        document["recording"] = str(stream.close(recording, {"result": result, "scene": scene}))
    except BadInput as error:
        document["replicas"][0]["warnings"].insert(0, str(error))
    results.write_document_or_warn(recording.path, document)
