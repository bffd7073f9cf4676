"""What a session shows: pictures of its grains, a recording that grows, numbers in one line."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichi_erosion.recording import pictures, stream
from taichi_erosion.recording.pictures import write_png
from taichi_erosion.recording.side_view import SideView
from taichi_erosion.recording.wall_mesh import wall_meshes
from taichi_erosion.run.live import Session
from taichi_erosion.run.watch import RESTING_SHARE, Image, apparatus_box
from taichi_erosion.simulation import ledger, snapshot

ROUNDING = 1e-9  # of an interval: a moment that lies on it counts as reached [1]


def resting_speed(session: Session) -> float:
    """Speed below which a grain is drawn as resting [m s-1]."""
    setup = session.sim.setups[0]
    diameter = 2.0 * float(np.median(setup.grains.radius))
    return RESTING_SHARE * float(np.sqrt(np.linalg.norm(setup.gravity) * diameter))


def side_picture(session: Session, is_lettered: bool) -> Image:
    """The grains seen from the side, with time and scale if they can be read."""
    box = apparatus_box(session.sim.setups[0])
    standing = frozenset(wall for s in session.scene.stages for wall in (*s.remove, *s.move))
    gone = {name for s in session.scene.stages[: session.stage + 1] for name in s.remove}
    walls = [w for w in wall_meshes(session.sim.setups[0], box, standing) if w.name not in gone]
    view = SideView((box[0][0], box[0][2]), (box[1][0], box[1][2]))
    speeds = (resting_speed(session), stream.FASTEST_COLOUR)
    draw = pictures.film_frame if is_lettered else pictures.side_picture
    return draw(snapshot(session.sim, 0), view, walls, speeds)


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
    interval: float  # s
    shots: int = 0


def open_film(session: Session, path: Path, viewer: str | None = None) -> Film:
    """Begin a recording that a rerun viewer may follow; the session logs to it from now on."""
    scene, setup = session.scene, session.sim.setups[0]
    moving = frozenset(wall for s in scene.stages for wall in (*s.remove, *s.move))
    walls = wall_meshes(setup, apparatus_box(setup), moving)
    text = session.path.read_text(encoding="utf-8")
    name = f"{scene.scene.title or session.path.stem}, live"
    header = stream.RunHeader(path.stem, name, scene.scene.kind, text, setup.grains.radius, walls)
    film = Film(stream.open_recording(path, header, viewer), scene.record.every)
    session.watchers.append(lambda now: shoot(film, now))
    return film


def shoot(film: Film, session: Session) -> None:
    """Log a frame when one is due."""
    if session.time >= film.shots * film.interval * (1.0 - ROUNDING):
        stream.log_frame(film.recording, snapshot(session.sim, 0), resting_speed(session))
        stream.log_ledger(film.recording, ledger(session.sim, 0))
        film.shots = int(session.time / film.interval * (1.0 + ROUNDING)) + 1
