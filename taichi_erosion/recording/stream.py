"""One recording per run: grains, walls, ledger, pictures and texts in rerun's file format.

The file grows as PATH.part and takes its name when it is closed. A run killed at any moment leaves a part
file that `readback` and the viewer can read; it lacks at most what was logged in the last FLUSH_INTERVAL.
"""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from math import log10
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import make_parent, part_path
from taichi_erosion.core.snapshot import Ledger, Snapshot
from taichi_erosion.recording import pictures as drawing
from taichi_erosion.recording.blueprint import MAGNIFICATION, TIMELINE, WIND_KINDS, blueprint, choose_focus
from taichi_erosion.recording.disk_space import abandon_writer, lock_part_file
from taichi_erosion.recording.static_grains import StaticGrains, is_static, update_static_grains
from taichi_erosion.recording.wall_mesh import WallMesh

if TYPE_CHECKING:
    import rerun as rr

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

APPLICATION = "taichi_erosion"
FLUSH_INTERVAL = 1.0  # s of wall time between writes; more often costs 1 kB per entity and write
FLUSH_LIMIT = 30.0  # s until a disk that takes nothing is an error
JPEG_QUALITY = 95  # of 100
CURVE_WIDTH = 1.5  # points
WALL_OPACITY = 48  # of 255
FASTEST_COLOUR = 2.0  # m s-1, drawn in the last colour: the pouring speed of the published funnel test
CURVES = {  # entries of the ledger that are drawn: legend and colour
    "kinetic_translation": ("translation", drawing.EMBER),
    "kinetic_rotation": ("rotation", (240, 190, 80)),
    "elastic": ("elastic", (110, 200, 190)),
    "contacts": ("contacts", drawing.SAND),
    "released": ("grains released", drawing.STEEL),
    "overlap_largest": ("largest overlap / radius", drawing.EMBER),
    "speed_largest": ("largest speed, m/s", (120, 220, 255)),
}
# J, drawn as log10: coming to rest is a fall over decades
DECADES = ("kinetic_translation", "kinetic_rotation", "elastic")
TRANSPORT = {  # curves of grains under wind
    "flux": ("flux, kg/(m s)", drawing.SAND),
    "flying": ("share of the grains above the bed", drawing.EMBER),
    "friction_velocity": ("friction velocity, m/s", (120, 220, 255)),
}


@dataclass(frozen=True)
class RunHeader:
    """What is known of a run before its first step."""

    recording_id: str
    name: str
    kind: str
    scene_text: str  # the scene file, TOML
    radii: Floats  # [n] m, of all grains that the run will release
    walls: tuple[WallMesh, ...] = ()
    foot: Vector = (0.0, 0.0, 0.0)  # m, where the heap stands, if the scene makes one
    application: str = APPLICATION


@dataclass
class Recording:
    """An open recording."""

    path: Path
    stream: "rr.RecordingStream"
    static_grains: StaticGrains = field(default_factory=StaticGrains.empty)
    lock: Any = None  # lock of the part file, held until the recording is closed


@contextmanager
def recorded(path: Path, header: RunHeader) -> Iterator[Recording]:
    """A recording that is closed whatever happens inside, Ctrl-C included."""
    recording = open_recording(path, header)
    try:
        yield recording
    finally:
        close(recording)


def open_recording(path: Path, header: RunHeader, viewer: str | None = None) -> Recording:
    """Begin PATH.part with its blueprint, scene and walls; `viewer` is the address of one that follows."""
    import rerun as rr

    make_parent(path)
    batches = rr.ChunkBatcherConfig(flush_tick=FLUSH_INTERVAL)
    stream = rr.RecordingStream(header.application, recording_id=header.recording_id, batcher_config=batches)
    focus = choose_focus(header.kind, header.radii, header.walls, header.foot)
    try:
        lock = lock_part_file(part_path(path))
        sinks = [rr.FileSink(part_path(path)), *([rr.GrpcSink(viewer)] if viewer else [])]
        stream.set_sinks(*sinks, default_blueprint=blueprint(header.kind, focus))
    except OSError as error:
        raise BadInput(f"{path}: the recording cannot be written ({error.strerror})") from error
    except RuntimeError as error:  # so rerun says that the disk takes not even the first bytes
        abandon_writer(stream)
        raise BadInput(f"{path}: the recording cannot be begun ({error})") from error
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    stream.send_recording_name(header.name)
    recording = Recording(path, stream, lock=lock)
    log_header(recording, header)
    flush(recording)
    return recording


def log_header(recording: Recording, header: RunHeader) -> None:
    """Write what does not change: axes, scene text, curves' names, walls."""
    import rerun as rr

    stream = recording.stream
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("world", rr.Transform3D(scale=MAGNIFICATION), static=True)
    text = f"# {header.name}\n\n```toml\n{header.scene_text}\n```\n"
    stream.log("scene", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)
    for entry, (legend, colour) in (CURVES | (TRANSPORT if header.kind in WIND_KINDS else {})).items():
        folder = "decades" if entry in DECADES else "transport" if entry in TRANSPORT else "ledger"
        curve = rr.SeriesLines(names=legend, colors=[colour], widths=CURVE_WIDTH)
        stream.log(f"{folder}/{entry}", curve, static=True)
    set_time(recording, 0.0, 0)
    for wall in header.walls:
        log_wall(recording, wall)


def log_wall(recording: Recording, wall: WallMesh) -> None:
    """Write a wall. One that may be taken away is not static: rerun never forgets what is static."""
    import rerun as rr

    mesh = rr.Mesh3D(
        vertex_positions=wall.vertices.astype(np.float32),
        triangle_indices=wall.triangles.astype(np.uint32),
        albedo_factor=(*drawing.STEEL, WALL_OPACITY),
    )
    recording.stream.log(wall_entity(wall.name), mesh, static=not wall.moving)


def wall_entity(name: str) -> str:
    """Entity of a wall, its name escaped for paths."""
    import rerun as rr

    return rr.new_entity_path(["world", "walls", name])


def set_time(recording: Recording, time: float, step: int) -> None:
    """Everything logged from here on belongs to this time [s] and step."""
    recording.stream.set_time(TIMELINE, duration=time)
    recording.stream.set_time("step", sequence=step)


def log_frame(recording: Recording, snapshot: Snapshot, moving_speed: float) -> None:
    """Write the grains: those at rest to world/bed, when `update_bed` asks for it, others to world/mobile."""
    set_time(recording, snapshot.time, snapshot.step)
    recording.static_grains, is_new = update_static_grains(recording.static_grains, snapshot, moving_speed)
    resting = is_static(recording.static_grains, snapshot)
    if is_new:
        tints = drawing.resting_colours(snapshot.ident[resting])
        log_grains(recording, "world/bed", snapshot, resting, tints)
    speed = np.linalg.norm(snapshot.velocity[~resting], axis=1)
    colours = drawing.speed_colours(speed, moving_speed, max(FASTEST_COLOUR, 2.0 * moving_speed))
    log_grains(recording, "world/mobile", snapshot, ~resting, colours)


def log_grains(
    recording: Recording, entity: str, snapshot: Snapshot, rows: NDArray[np.bool_], colours: NDArray[np.uint8]
) -> None:
    """Write some of the grains, and what effects remember of them.

    Their radii too, since which grains they are changes from frame to frame.
    """
    import pyarrow as pa
    import rerun as rr

    points = rr.Points3D.from_fields(
        positions=snapshot.position[rows].astype(np.float32),
        radii=snapshot.radius[rows].astype(np.float32),
        colors=colours,
    )
    # an Arrow array has a type even where it is empty, which rerun cannot guess
    ident = pa.array(snapshot.ident[rows], type=pa.int32())
    remembered = {
        name.replace(".", "_"): pa.array(values[rows], type=pa.float32())
        for name, values in snapshot.effect_state.items()
    }
    recording.stream.log(entity, points, rr.AnyValues(ident=ident, **remembered))


def log_ledger(recording: Recording, ledger: Ledger) -> None:
    """Write all sums of the ledger, and the decades of its energies where they are positive."""
    import rerun as rr

    set_time(recording, ledger.time, ledger.step)
    entries = asdict(ledger)
    for entry in entries.keys() - {"time", "step"}:
        recording.stream.log(f"ledger/{entry}", rr.Scalars(entries[entry]))
    for entry in DECADES:
        if entries[entry] > 0.0:
            recording.stream.log(f"decades/{entry}", rr.Scalars(log10(entries[entry])))


def log_transport(recording: Recording, values: Mapping[str, float]) -> None:
    """Write values of TRANSPORT at the time of the latest frame."""
    import rerun as rr

    for entry, value in values.items():
        recording.stream.log(f"transport/{entry}", rr.Scalars(value))


def log_image(recording: Recording, entity: str, image: NDArray[np.uint8], timeless: bool = False) -> None:
    """Write a colour picture [height, width, 3], at the time of the latest frame or for all times."""
    import rerun as rr

    picture = rr.Image(image, color_model="RGB").compress(jpeg_quality=JPEG_QUALITY)
    recording.stream.log(entity, picture, static=timeless)


def log_text(recording: Recording, level: Literal["INFO", "WARN", "ERROR"], text: str) -> None:
    """Write a line to the log at the time of the latest frame or ledger."""
    import rerun as rr

    recording.stream.log("log", rr.TextLog(text, level=level))


def log_wall_pose(
    recording: Recording, name: str, translation: Vector, quaternion: tuple[float, float, float, float]
) -> None:
    """Write where a wall is now: turned by `quaternion` (w, x, y, z), then shifted by `translation` [m]."""
    import rerun as rr

    w, x, y, z = quaternion
    pose = rr.Transform3D(translation=translation, quaternion=rr.Quaternion(xyzw=(x, y, z, w)))
    recording.stream.log(wall_entity(name), pose)


def log_wall_removed(recording: Recording, name: str) -> None:
    """Take a wall out of the picture from now on; only one whose mesh says `moving`."""
    import rerun as rr

    recording.stream.log(wall_entity(name), rr.Clear(recursive=False))


def set_properties(
    recording: Recording, group: Literal["result", "scene", "doe"], values: Mapping[str, Any]
) -> None:
    """Write properties of the run; they become columns of rerun's table of runs. None is left out."""
    import rerun as rr

    known = {name: value for name, value in values.items() if value is not None}
    if known:
        recording.stream.send_property(group, rr.AnyValues(**known))


def flush(recording: Recording) -> None:
    """Hand everything to the operating system: what was logged survives the death of this process.

    Raises BadInput where the disk takes nothing more; what it took can be read.
    """
    try:
        recording.stream.flush(timeout_sec=FLUSH_LIMIT)
    except RuntimeError:
        abandon_writer(recording.stream)
        kept = f"{part_path(recording.path)} holds the beginning"
        raise BadInput(f"{recording.path}: cannot be written to its end; {kept}") from None


def close(recording: Recording) -> Path:
    """Finish the file and give it its name; closing twice does no harm."""
    part = part_path(recording.path)
    if part.exists():
        flush(recording)
        recording.stream.disconnect()
        os.replace(part, recording.path)
    if recording.lock is not None:
        recording.lock.close()
    return recording.path
