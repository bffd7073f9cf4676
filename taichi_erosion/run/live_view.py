"""What a session shows: pictures of its grains, a recording that grows, numbers in one line."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.recording import pictures, stream
from taichi_erosion.recording.pictures import write_png
from taichi_erosion.recording.side_view import SideView
from taichi_erosion.run.live import Session
from taichi_erosion.run.scene_run import scene_text
from taichi_erosion.run.scenery import Scenery, log_scenery, scenery_of, standing
from taichi_erosion.run.transport import log_transport
from taichi_erosion.run.watch import RESTING_SHARE, Image, apparatus_box
from taichi_erosion.simulation import ledger, snapshot

MARGIN = 0.01  # m, half the width of a window without grains
WINDOW = (480, 240)  # px: a line of a terminal is twice as high as a character is wide
ROUNDING = 1e-9  # of an interval: a moment that lies on it counts as reached [1]


def resting_speed(session: Session) -> float:
    """Speed below which a grain is drawn as resting [m s-1]."""
    setup = session.sim.setups[0]
    diameter = 2.0 * float(np.median(setup.grains.radius))
    return RESTING_SHARE * float(np.sqrt(np.linalg.norm(setup.gravity) * diameter))


def side_picture(session: Session, is_lettered: bool) -> Image:
    """The grains seen from the side, with time and scale if they can be read."""
    box = apparatus_box(session.sim.setups[0])
    walls = standing(scenery_of(session.scene, session.sim.setups[0], box), session.sim, 0)
    speeds, state = (resting_speed(session), stream.FASTEST_COLOUR), snapshot(session.sim, 0)
    if is_lettered:
        view = SideView((box[0][0], box[0][2]), (box[1][0], box[1][2]))
        return pictures.film_frame(state, view, walls, speeds)
    return pictures.side_picture(state, close_view(state), walls, speeds)


def close_view(state: Snapshot) -> SideView:
    """Window around the grains alone, for pictures of few pixels; without grains a small one."""
    if not len(state.position):
        return SideView((-MARGIN, 0.0), (MARGIN, MARGIN), WINDOW)
    places, margin = state.position[:, [0, 2]], 4.0 * float(state.radius.max())
    low, high = places.min(axis=0) - margin, places.max(axis=0) + margin
    floor = float(places[:, 1].min() - state.radius.max())
    return SideView((float(low[0]), floor), (float(high[0]), float(high[1])), WINDOW)


def write_picture(session: Session, path: Path) -> Path:
    """Write the side picture as PNG."""
    return write_png(path, side_picture(session, is_lettered=True))


def numbers(session: Session) -> dict[str, float | int | str]:
    """Where the session stands."""
    sums = ledger(session.sim, 0)
    return {
        "time_s": round(session.time, 9),
        "stage": session.scene.stages[session.stage].name,
        "released": sums.released,
        "contacts": sums.contacts,
        "kinetic_J": sums.kinetic_translation + sums.kinetic_rotation,
        "speed_largest_m_s": sums.speed_largest,
        "overlap_largest": sums.overlap_largest,
    }


@dataclass
class Film:
    """The recording of a session."""

    recording: stream.Recording
    scenery: Scenery
    interval: float  # s
    shots: int = 0


def open_film(session: Session, path: Path, viewer: str | None = None) -> Film:
    """Begin a recording that a rerun viewer may follow; the session logs to it from now on."""
    scene, setup = session.scene, session.sim.setups[0]
    scenery = scenery_of(scene, setup, apparatus_box(setup))
    text = scene_text(session.path, session.overrides)
    name = f"{scene.scene.title or session.path.stem}, live"
    header = stream.RunHeader(path.stem, name, scene.scene.kind, text, setup.grains.radius, scenery.walls)
    film = Film(stream.open_recording(path, header, viewer), scenery, scene.record.every)
    session.watchers.append(lambda now: shoot(film, now))
    return film


def shoot(film: Film, session: Session) -> None:
    """Log a frame when one is due; a session that went back writes its later frames anew."""
    due = film.shots * film.interval * (1.0 - ROUNDING)
    went_back = session.time < due - film.interval
    film.scenery.is_rewritten |= went_back
    if session.time >= due or went_back:
        state = snapshot(session.sim, 0)
        stream.log_frame(film.recording, state, resting_speed(session))
        stream.log_ledger(film.recording, ledger(session.sim, 0))
        log_scenery(film.recording, film.scenery, session.sim, 0)
        log_transport(film.recording, session.scene, session.sim, 0, state)
        film.shots = int(session.time / film.interval * (1.0 + ROUNDING)) + 1
