"""Recording of one replica: frames, walls, wind and film while it runs; pictures and results at its end."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion import simulation
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import PrimitiveKind, Setup, Triple
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.execution.ensemble_loop import EnsembleRun
from taichi_erosion.execution.observables import wind_patch_of_scene
from taichi_erosion.execution.stages import count_whole_intervals, present_grain_fields
from taichi_erosion.measures.silhouette import draw_silhouette, largest_connected_body
from taichi_erosion.measures.wind_bed import flux_of_frame
from taichi_erosion.recording import pictures, stream
from taichi_erosion.recording.air_recording import log_grain_fields, log_height_profile
from taichi_erosion.recording.wall_mesh import WallMesh, triangulate, wall_meshes
from taichi_erosion.scene import Scene
from taichi_erosion.simulation import Simulation

Properties = Mapping[str, Mapping[str, Any]]  # by group: columns of rerun's table of runs

RESTING_SHARE = 0.02  # of sqrt(g d), without weight of FASTEST_COLOUR: slower grains are drawn as bed [1]
FILM_FRAMES = 120  # most pictures in a film; beyond, every second one is dropped and the interval doubled
FILM_DURATION = 0.06  # s each picture is shown
OPEN_MARGIN = 0.25  # share by which an endless plate is drawn beyond the apparatus [1]


@dataclass
class Recorder:
    """Open recording of one replica, and the pictures of its film."""

    replica: int
    recording: stream.Recording
    walls: tuple[WallMesh, ...]  # in their starting positions
    view: pictures.SideView
    resting_speed: float  # m s-1
    interval: float  # s between frames; infinite once the recording is closed
    frames: int = 0  # intervals of which a frame is written
    stage: int = 0
    film: list[pictures.Picture] = field(default_factory=list)
    film_every: int = 1  # frames for one picture of the film
    is_rewritten: bool = False  # walls that have gone may come back


def open_recorder(path: Path, title: str, text: str, sim: Simulation, scene: Scene, replica: int) -> Recorder:
    """Begin the recording of a replica; `text` is the scene as it is run. Raises BadInput."""
    setup = sim.setups[replica]
    walls = meshes_of(scene, setup)
    extras = {"contacts": scene.record.contacts, "fields": scene.record.fields}
    header = stream.RunHeader(title, scene.scene.kind or "own", text, setup.grains.radius, walls, **extras)
    recording = stream.open_recording(path, header)
    stream.log_colour_legend(recording, resting_speed(setup))
    return Recorder(replica, recording, walls, side_view(setup), resting_speed(setup), scene.record.every)


def resting_speed(setup: Setup) -> float:
    """Speed below which a grain is drawn as resting [m s-1]."""
    diameter = 2.0 * float(np.median(setup.grains.radius))
    return RESTING_SHARE * float(np.sqrt(np.linalg.norm(setup.gravity) * diameter) or stream.FASTEST_COLOUR)


def side_view(setup: Setup) -> pictures.SideView:
    """Window of the film: the whole apparatus."""
    low, high = corners_of_apparatus_box(setup)
    return pictures.SideView((low[0], low[2]), (high[0], high[2]))


def meshes_of(scene: Scene, setup: Setup) -> tuple[WallMesh, ...]:
    """All walls; endless ones end at the box around the apparatus."""
    moving = frozenset(wall for stage in scene.stages for wall in (*stage.remove, *stage.move))
    return wall_meshes(setup, corners_of_apparatus_box(setup), moving)


def corners_of_apparatus_box(setup: Setup) -> tuple[Triple, Triple]:
    """Corners [m] of a box around finite walls and starting grains, with a margin for what spreads."""
    table = setup.primitives
    nowhere = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    rows = zip(map(PrimitiveKind, table.kind), table.shape, strict=True)
    walls = [triangulate(kind, row, nowhere)[0] for kind, row in rows if kind != PrimitiveKind.PLANE]
    corners = np.concatenate([setup.grains.position, *walls])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = OPEN_MARGIN * float((high - low).max()) + float(setup.grains.radius.max())
    side = np.array([margin, margin, 0.0])
    low, high = low - side, high + side
    low[2], high[2] = min(low[2], 0.0), high[2] + float(setup.grains.radius.max())
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def record_replica(recorder: Recorder, ensemble: EnsembleRun) -> None:
    """Write stages that have begun, and a frame where one is due or the replica has ended.

    On a nearly full disk the recording is closed, whole, so that results still fit.
    """
    state, recording = ensemble.states[recorder.replica], recorder.recording
    if recorder.interval == inf:
        return
    if stream.is_disk_nearly_full(recording.path):
        warning = f"the disk is nearly full: the recording ends at {ensemble.time:.6g} s"
        stream.log_text(recording, "WARN", warning)
        stream.close(recording)
        recorder.interval = inf
        state.warn(warning)
        return
    stages = ensemble.scenes[recorder.replica].stages
    while recorder.stage < min(state.stage, len(stages) - 1):
        recorder.stage += 1
        stream.log_text(recording, "INFO", f"stage {stages[recorder.stage].name} begins")
    if count_whole_intervals(ensemble.time, recorder.interval) >= recorder.frames or not state.active:
        record_frame_and_picture(recorder, ensemble)
        if not state.active:
            recorder.interval = inf


def record_frame_and_picture(recorder: Recorder, ensemble: EnsembleRun) -> None:
    """One frame of the recording, and one picture of the film if it is due."""
    now = log_present_frame(recorder, ensemble.sim, ensemble.scenes[recorder.replica])
    if recorder.frames % recorder.film_every == 0:
        speeds = (recorder.resting_speed, stream.FASTEST_COLOUR)
        walls = present_walls(recorder.walls, ensemble.sim, recorder.replica)
        recorder.film.append(pictures.film_frame(now, recorder.view, walls, speeds))
    if len(recorder.film) > FILM_FRAMES:
        recorder.film = recorder.film[::2]
        recorder.film_every *= 2
    recorder.frames = count_whole_intervals(ensemble.time, recorder.interval) + 1


def log_present_frame(recorder: Recorder, sim: Simulation, scene: Scene) -> Snapshot:
    """Write grains, totals, walls and wind as they are now; returns the snapshot of the grains."""
    now = simulation.snapshot(sim, recorder.replica)
    stream.log_frame(recorder.recording, now, recorder.resting_speed)
    stream.log_totals(recorder.recording, simulation.energy_totals(sim, recorder.replica))
    log_changed_walls(recorder, sim)
    if scene.record.contacts:
        stream.log_contacts(recorder.recording, simulation.contact_network(sim, recorder.replica))
    if scene.record.fields and len(now.mass):
        log_grain_fields(recorder.recording, present_grain_fields(sim, recorder.replica))
    if scene.wind is not None:
        air = simulation.air_profile(sim, recorder.replica)
        log_height_profile(recorder.recording, air.velocity[:, 0], air.face)
        patch = wind_patch_of_scene(scene)
        flying = float((now.position[:, 2] > patch.clear).sum()) / max(len(now.position), 1)
        values = {"flux": flux_of_frame(now, patch), "flying": flying}
        values["friction_velocity"] = simulation.friction_velocity(sim, recorder.replica)
        stream.log_curve_values(recorder.recording, "transport", values)
    return now


def log_changed_walls(recorder: Recorder, sim: Simulation) -> None:
    """Write the walls that move, or have gone, as they are now."""
    movable = [wall for wall in recorder.walls if wall.moving]
    poses = simulation.wall_poses(sim, recorder.replica) if movable else {}
    for wall in movable:
        pose = poses[wall.name]
        if not pose.present:
            stream.log_wall_removed(recorder.recording, wall.name)
            continue
        if recorder.is_rewritten:
            stream.log_wall(recorder.recording, wall)
        stream.log_wall_pose(recorder.recording, wall.name, pose.rotation, pose.translation)


def present_walls(walls: tuple[WallMesh, ...], sim: Simulation, replica: int) -> tuple[WallMesh, ...]:
    """The walls that have not been removed, at their present poses."""
    if not any(wall.moving for wall in walls):
        return walls
    poses = simulation.wall_poses(sim, replica)
    standing = [(wall, poses[wall.name]) for wall in walls if poses[wall.name].present]
    return tuple(replace(w, vertices=w.vertices @ at.rotation.T + at.translation) for w, at in standing)


def finish_recording(
    recorder: Recorder, ensemble: EnsembleRun, record: dict[str, Any], properties: Properties
) -> dict[str, str]:
    """Write pictures, warnings and properties of a replica, then close; returns the files by kind.

    `record` is that of the replica, and is warned of files that cannot be written; `properties` are further
    columns of rerun's table of runs.
    """
    recording = recorder.recording
    result = {name: measured["value"] for name, measured in record["measures"].items()}
    scene = {"seed": record["seed"]} | dict(properties.get("scene", {}))
    try:
        files = {"recording": str(recording.path)} | write_silhouettes_and_film(recorder, ensemble)
        for warning in record["warnings"]:
            stream.log_text(recording, "WARN", warning)
        stream.close(recording, {"result": result, "scene": scene, "doe": properties.get("doe", {})})
    except BadInput as error:
        record["warnings"].insert(0, str(error))
        return {}
    return files


def write_silhouettes_and_film(recorder: Recorder, ensemble: EnsembleRun) -> dict[str, str]:
    """Write silhouettes of the heap, where they were measured, and the film; returns the files by kind."""
    path = recorder.recording.path
    files = {}
    for name in ("repose_angle", "angle_of_repose"):
        measurement = ensemble.states[recorder.replica].measurements.get(name)
        if measurement is not None and measurement.details.get("lines"):
            image = heap_silhouettes(simulation.snapshot(ensemble.sim, recorder.replica), measurement.details)
            stream.log_image(recorder.recording, "silhouette", image, timeless=True)
            files["silhouettes"] = str(pictures.write_png(path.with_suffix(".png"), image))
    if recorder.film:
        files["film"] = str(pictures.write_gif(path.with_suffix(".gif"), recorder.film, FILM_DURATION))
    return files


def heap_silhouettes(state: Snapshot, details: dict[str, Any]) -> pictures.Picture:
    """Silhouettes of a heap on z = 0 from all measured azimuths, with the fitted flanks."""
    grain = 2.0 * float(np.median(state.radius))
    masks, flanks, captions = [], [], []
    lines = np.array(details["lines"]).reshape(-1, 5)
    above = state.position[:, 2] > 0.0
    for azimuth in np.unique(lines[:, 0]):
        turn = float(np.radians(azimuth))
        silhouette = draw_silhouette(state.position[above], state.radius[above], turn, 0.0, grain)
        mask = largest_connected_body(silhouette.image)
        columns = np.flatnonzero(mask.any(axis=0))
        ends = lines[lines[:, 0] == azimuth][:, 1:].reshape(-1, 2, 2)
        column = (ends[..., 0] - silhouette.left) / silhouette.pixel - columns[0]
        flanks.append(np.stack([column, mask.shape[0] - ends[..., 1] / silhouette.pixel], axis=-1))
        masks.append(mask[:, columns[0] : columns[-1] + 1])
        captions.append(f"{azimuth:.0f}")
    return pictures.silhouette_grid(masks, flanks, captions)
