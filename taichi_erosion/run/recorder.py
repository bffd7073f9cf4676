"""Walls in recordings and pictures: as they stand at the moment that is shown.

What a recording shows of grains under wind: the wind's profile, and what it carries.

What happens beside the simulation: recording, film, checkpoints, progress.

What has been simulated outlives a disk that refuses to hold all of it.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats, PrimitiveKind, Setup, Triple
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.silhouette import draw_silhouette, largest_body
from taichi_erosion.measures.wind_bed import Patch, flux_of
from taichi_erosion.recording import stream
from taichi_erosion.recording.air_recording import log_profile
from taichi_erosion.recording.checkpoint import save_checkpoint
from taichi_erosion.recording.disk_space import is_short_of_room
from taichi_erosion.recording.pictures import SideView, film_frame, silhouette_grid, write_gif, write_png
from taichi_erosion.recording.wall_mesh import WallMesh, wall_meshes
from taichi_erosion.run.ensemble_loop import Play, share_done
from taichi_erosion.run.observables import patch_of
from taichi_erosion.run.options import Report
from taichi_erosion.run.resume import remembered
from taichi_erosion.scene import Scene
from taichi_erosion.simulation import (
    Simulation,
    WallPose,
    air_profile,
    export_state,
    friction_velocity,
    ledger,
    snapshot,
    wall_poses,
)


@dataclass
class Scenery:
    """Walls of one replica."""

    walls: tuple[WallMesh, ...]  # as they stood at the start
    gone: set[str] = field(default_factory=set)  # those that the recording has been told are gone
    poses: dict[str, tuple[Floats, Floats]] = field(default_factory=dict)  # last written, by name
    is_rewritten: bool = False  # a session went back: what it wrote of later times no longer holds


def scenery_of(scene: Scene, setup: Setup, box: tuple[Triple, Triple]) -> Scenery:
    """All walls, endless ones as far as the box reaches [m]."""
    moving = frozenset(wall for stage in scene.stages for wall in (*stage.remove, *stage.move))
    return Scenery(wall_meshes(setup, box, moving))


def standing(scenery: Scenery, sim: Simulation, replica: int) -> tuple[WallMesh, ...]:
    """The walls that are there, where they are."""
    if not any(wall.moving for wall in scenery.walls):
        return scenery.walls
    poses = wall_poses(sim, replica)
    return tuple(placed(wall, poses[wall.name]) for wall in scenery.walls if poses[wall.name].present)


def placed(wall: WallMesh, pose: WallPose) -> WallMesh:
    """A wall at its pose."""
    return replace(wall, vertices=wall.vertices @ pose.rotation.T + pose.translation) if wall.moving else wall


def log_scenery(recording: stream.Recording, scenery: Scenery, sim: Simulation, replica: int) -> None:
    """Write what has moved or vanished since the last call, at the recording's present time."""
    movable = [wall for wall in scenery.walls if wall.moving]
    poses = wall_poses(sim, replica) if movable else {}
    for wall in movable:
        if poses[wall.name].present:
            log_standing(recording, scenery, wall, poses[wall.name])
        elif wall.name not in scenery.gone:
            stream.log_wall_removed(recording, wall.name)
            scenery.gone.add(wall.name)


def log_standing(recording: stream.Recording, scenery: Scenery, wall: WallMesh, pose: WallPose) -> None:
    """Write a wall that is there, if it is not as it was last written."""
    rotation, translation = scenery.poses.get(wall.name, (np.eye(3), np.zeros(3)))
    if scenery.is_rewritten:
        stream.log_wall(recording, wall)
        scenery.gone.discard(wall.name)
    elif np.array_equal(rotation, pose.rotation) and np.array_equal(translation, pose.translation):
        return
    x, y, z, w = scipy.spatial.transform.Rotation.from_matrix(pose.rotation).as_quat().tolist()
    along, across, up = pose.translation.tolist()
    stream.log_wall_pose(recording, wall.name, (along, across, up), (w, x, y, z))
    scenery.poses[wall.name] = (pose.rotation, pose.translation)


def log_transport(
    recording: stream.Recording, scene: Scene, sim: Simulation, replica: int, state: Snapshot
) -> None:
    """Write the profile of the wind and the curves of `transport_of` at the time of the latest frame."""
    if scene.wind is None:
        return
    air = air_profile(sim, replica)
    log_profile(recording, air.velocity[:, 0], air.face)
    values = transport_of(state, patch_of(scene))
    stream.log_transport(recording, values | {"friction_velocity": friction_velocity(sim, replica)})


def transport_of(state: Snapshot, patch: Patch) -> dict[str, float]:
    """Flux [kg m-1 s-1], and the share of the grains that fly: that are above the bed [1]."""
    flying = float(np.mean(state.position[:, 2] > patch.clear)) if len(state.position) else 0.0
    return {"flux": flux_of(state, patch), "flying": flying}


Image = NDArray[np.uint8]
Properties = Mapping[str, Mapping[str, Any]]  # by group: what rerun's table of runs shows

RESTING_SHARE = 0.02  # of sqrt(g d): slower grains are drawn as bed [1]
FILM_FRAMES = 120  # most pictures in a film; beyond, every second one is dropped and the interval doubled
FILM_DURATION = 0.06  # s each picture is shown
PROGRESS_INTERVAL = 0.2  # s of wall time
ROUNDING = 1e-9  # of an interval: a moment that lies on it counts as reached [1]
OPEN_MARGIN = 0.25  # share by which an endless plate is drawn beyond the apparatus [1]


@dataclass
class Camera:
    """Recording and film of one replica."""

    replica: int
    recording: stream.Recording
    scenery: Scenery
    view: SideView
    resting_speed: float  # m s-1
    interval: float  # s between frames
    shot: int = 0  # frames taken
    stage: int = 0
    film: list[Image] = field(default_factory=list)
    film_every: int = 1  # frames for one picture of the film


def whole_intervals(time: float, interval: float) -> int:
    """Intervals that have passed."""
    return int(time / interval * (1.0 + ROUNDING))


def open_camera(path: Path, name: str, stage_play: Play, text: str, replica: int = 0) -> Camera:
    """Begin the recording of a replica as it stands. Raises BadInput where it cannot be written."""
    scene, setup = stage_play.scenes[replica], stage_play.sim.setups[replica]
    box = apparatus_box(setup)
    scenery = scenery_of(scene, setup, box)
    header = stream.RunHeader(path.stem, name, scene.scene.kind, text, setup.grains.radius, scenery.walls)
    diameter = 2.0 * float(np.median(setup.grains.radius))
    speed = RESTING_SHARE * float(np.sqrt(np.linalg.norm(setup.gravity) * diameter))
    view = SideView((box[0][0], box[0][2]), (box[1][0], box[1][2]))
    shot = whole_intervals(stage_play.time, scene.record.every)
    recording = stream.open_recording(path, header)
    return Camera(replica, recording, scenery, view, speed, scene.record.every, shot)


def apparatus_box(setup: Setup) -> tuple[Triple, Triple]:
    """Corners [m] of a box around finite walls and starting grains, with a margin for what spreads."""
    points = [setup.grains.position]
    for kind, row in zip(setup.primitives.kind, setup.primitives.shape, strict=True):
        if kind == PrimitiveKind.TRIANGLE:
            points.append(row[:9].reshape(3, 3))
        elif kind == PrimitiveKind.REVOLVED:
            across = max(row[6], row[8]) * (1.0 - np.abs(row[3:6]))
            ends = row[:3] + np.outer(row[[7, 9]], row[3:6])
            points += [ends - across, ends + across]
    corners = np.concatenate([np.atleast_2d(p) for p in points])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = OPEN_MARGIN * float((high - low).max()) + float(setup.grains.radius.max())
    side = np.array([margin, margin, 0.0])
    low, high = low - side, high + side
    low[2] = min(low[2], 0.0)
    return corner(low), corner(high)


def corner(point: Floats) -> Triple:
    """A point as plain numbers."""
    x, y, z = point.tolist()
    return x, y, z


def watch_replica(camera: Camera, stage_play: Play) -> None:
    """Log the replica whenever a frame is due, and what its stages change."""
    actor = stage_play.actors[camera.replica]
    stages = stage_play.scenes[camera.replica].stages
    while camera.stage < min(actor.stage, len(stages) - 1):
        camera.stage += 1
        stream.log_text(camera.recording, "INFO", f"stage {stages[camera.stage].name} begins")
    ended = not actor.active
    if stage_play.time >= camera.shot * camera.interval * (1.0 - ROUNDING) or ended:
        if camera.interval < inf:
            take_frame(camera, stage_play)
        if ended:
            camera.interval = inf


def take_frame(camera: Camera, stage_play: Play) -> None:
    """One frame of the recording, and one of the film if it is due."""
    state = snapshot(stage_play.sim, camera.replica)
    stream.log_frame(camera.recording, state, camera.resting_speed)
    stream.log_ledger(camera.recording, ledger(stage_play.sim, camera.replica))
    log_scenery(camera.recording, camera.scenery, stage_play.sim, camera.replica)
    log_transport(camera.recording, stage_play.scenes[camera.replica], stage_play.sim, camera.replica, state)
    if camera.shot % camera.film_every == 0:
        speeds = (camera.resting_speed, stream.FASTEST_COLOUR)
        walls = standing(camera.scenery, stage_play.sim, camera.replica)
        camera.film.append(film_frame(state, camera.view, walls, speeds))
    if len(camera.film) > FILM_FRAMES:
        camera.film = camera.film[::2]
        camera.film_every *= 2
    camera.shot += 1


def finish(
    camera: Camera, stage_play: Play, record: dict[str, Any], properties: Properties
) -> dict[str, str]:
    """Last pictures and properties of the replica, then close the recording; returns the files by kind.

    `record` is what came out of the replica; `properties` are further columns of rerun's table of runs.
    """
    path, recording = camera.recording.path, camera.recording
    actor, files = stage_play.actors[camera.replica], {"recording": str(camera.recording.path)}
    for name in ("repose_angle", "angle_of_repose"):
        measurement = actor.measurements.get(name)
        if measurement is not None and measurement.details.get("lines"):
            end = snapshot(stage_play.sim, camera.replica)
            image = silhouettes(end, measurement.details, base_height=0.0)
            stream.log_image(recording, "silhouette", image, timeless=True)
            files["silhouettes"] = str(write_png(path.with_suffix(".png"), image))
    if camera.film:
        files["film"] = str(write_gif(path.with_suffix(".gif"), camera.film, FILM_DURATION))
    for warning in record["warnings"]:
        stream.log_text(recording, "WARN", warning)
    values = {name: found["value"] for name, found in record["measures"].items()}
    stream.set_properties(recording, "result", values)
    stream.set_properties(recording, "scene", {"seed": actor.seed} | dict(properties.get("scene", {})))
    stream.set_properties(recording, "doe", properties.get("doe", {}))
    stream.close(recording)
    return files


def silhouettes(state: Snapshot, details: dict[str, Any], base_height: float) -> Image:
    """Silhouettes of a heap from all measured azimuths, with the fitted flanks."""
    grain = 2.0 * float(np.median(state.radius))
    masks, flanks, captions = [], [], []
    lines = np.array(details["lines"]).reshape(-1, 5)
    above = state.position[:, 2] > base_height
    for azimuth in np.unique(lines[:, 0]):
        turn = float(np.radians(azimuth))
        drawn = draw_silhouette(state.position[above], state.radius[above], turn, base_height, grain)
        mask = largest_body(drawn.image)
        rows = mask.shape[0]
        ends = lines[lines[:, 0] == azimuth][:, 1:].reshape(-1, 2, 2)
        column = (ends[..., 0] - drawn.left) / drawn.pixel
        flanks.append(np.stack([column, rows - ends[..., 1] / drawn.pixel], axis=-1))
        columns = np.flatnonzero(mask.any(axis=0))
        masks.append(mask[:, columns[0] : columns[-1] + 1])
        flanks[-1][..., 0] -= columns[0]
        captions.append(f"{azimuth:.0f}")
    return silhouette_grid(masks, flanks, captions)


@dataclass
class Keeper:
    """Checkpoints at intervals of simulated time."""

    path: Path
    interval: float  # s
    meta: dict[str, Any]
    kept: int = 0

    def watch(self, stage_play: Play) -> None:
        """Save when the next interval is reached."""
        if stage_play.time >= (self.kept + 1) * self.interval * (1.0 - ROUNDING):
            self.kept = whole_intervals(stage_play.time, self.interval)
            self.save(stage_play)

    def save(self, stage_play: Play) -> None:
        """Write everything that the rest of the play depends on."""
        arrays, meta = remembered(stage_play)
        save_checkpoint(self.path, export_state(stage_play.sim) | arrays, self.meta | meta)


@dataclass
class Teller:
    """Progress words, not more often than a reader can follow."""

    report: Report
    last: float = 0.0

    def watch(self, stage_play: Play) -> None:
        """Say which stage runs, its time and its energy."""
        now = time.monotonic()
        if now - self.last < PROGRESS_INTERVAL:
            return
        self.last = now
        played = zip(stage_play.scenes, stage_play.actors, strict=True)
        active = [scene.stages[actor.stage].name for scene, actor in played if actor.active]
        name = active[0] if active else "measuring"
        self.report(share_done(stage_play), f"{name}, {stage_play.time:.3f} s simulated")


def watch_while_there_is_room(camera: Camera, stage_play: Play) -> None:
    """Record; while the disk still has room for the results, close the recording whole and go on without."""
    if camera.interval < inf and is_short_of_room(camera.recording.path):
        words = f"the disk is nearly full: the recording ends at {stage_play.time:.6g} s"
        stream.log_text(camera.recording, "WARN", words)
        stream.close(camera.recording)
        camera.interval = inf
        note(stage_play, camera.replica, words)
    if camera.interval < inf:
        watch_replica(camera, stage_play)


def save_when_due(keeper: Keeper, stage_play: Play) -> None:
    """Write a checkpoint; where that fails the one before stays, and the run goes on."""
    try:
        keeper.watch(stage_play)
    except BadInput as error:
        note(stage_play, 0, str(error))


def note(stage_play: Play, replica: int, words: str) -> None:
    """Warn once."""
    warnings = stage_play.actors[replica].warnings
    if words not in warnings:
        warnings.append(words)


def finish_or_warn(
    camera: Camera, stage_play: Play, record: dict[str, Any], properties: Properties
) -> dict[str, str]:
    """Files of a replica by kind; what cannot be written becomes a warning beside what was measured."""
    try:
        return finish(camera, stage_play, record, properties)
    except BadInput as error:
        record["warnings"].insert(0, str(error))
        return {}
