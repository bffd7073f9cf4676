"""What happens beside the simulation: recording, film, checkpoints, progress."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import Floats, PrimitiveKind, Setup, Triple
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.silhouette import draw_silhouette, largest_body
from taichi_erosion.recording import stream
from taichi_erosion.recording.checkpoint import save_checkpoint
from taichi_erosion.recording.pictures import film_frame, silhouette_grid, write_gif, write_png
from taichi_erosion.recording.side_view import SideView
from taichi_erosion.run.memory import remembered
from taichi_erosion.run.options import Report
from taichi_erosion.run.play import Play, share_done
from taichi_erosion.run.scenery import Scenery, log_scenery, scenery_of, standing
from taichi_erosion.run.transport import log_transport
from taichi_erosion.simulation import export_state, ledger, snapshot

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
