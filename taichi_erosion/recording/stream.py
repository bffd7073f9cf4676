"""Rerun recordings: one file per run with grains, walls, totals, pictures and texts.

The file grows as PATH.part and takes its name when it is closed. A run killed at any moment leaves a part
file that `readback` and the viewer can read; it lacks at most what was logged in the last FLUSH_INTERVAL.

Grains at rest (static grains) are the bulk of a recording; they are written only now and then.

rerun writes from a thread of its own. At the first byte that the disk refuses the thread ends, what is logged
afterwards goes nowhere, and the program would wait for that thread for ever when it leaves. A recording is
therefore closed, whole, while there still is room for the results; where the disk refuses even so, the wait
is called off.
"""

import atexit
import ctypes
import fcntl
import os
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from io import BufferedWriter
from math import log10
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import make_parent_folder, part_path
from taichi_erosion.core.setup import Floats, Integers
from taichi_erosion.core.snapshot import ContactNetwork, Snapshot, Totals
from taichi_erosion.recording import blueprint as blueprints
from taichi_erosion.recording import pictures, rr, rrb
from taichi_erosion.recording.wall_mesh import WallMesh

APPLICATION = "taichi_erosion"
FLUSH_INTERVAL = 1.0  # s of wall time between writes; more often costs 1 kB per entity and write
FLUSH_LIMIT = 30.0  # s until a disk that takes nothing is an error
FREE_SPACE_LEAST = 50e6  # bytes left free for documents, pictures and a checkpoint
JPEG_QUALITY = 95  # of 100
CURVE_WIDTH = 1.5  # points
WALL_OPACITY = 48  # of 255
FASTEST_COLOUR = 2.0  # m s-1, drawn in the last colour: the pouring speed of the published funnel test
SUMS = "ledger"  # folder of the totals in a recording; older recordings have it too
CURVES = {  # of the totals: legend and colour
    "decades/kinetic_translation": ("translation", pictures.EMBER),
    "decades/kinetic_rotation": ("rotation", (240, 190, 80)),
    "decades/elastic": ("elastic", (110, 200, 190)),
    f"{SUMS}/contacts": ("contacts", pictures.SAND),
    f"{SUMS}/released": ("grains released", pictures.STEEL),
    f"{SUMS}/overlap_largest": ("largest overlap / radius", pictures.EMBER),
    f"{SUMS}/speed_largest": ("largest speed, m/s", (120, 220, 255)),
}
# J, drawn as log10: coming to rest is a fall over decades
DECADES = ("kinetic_translation", "kinetic_rotation", "elastic")
CONTACTS = "world/contacts"
GRAINS = "world/grains"  # of a page
FRAME = "frame"  # timeline of a page
CONTACT_VECTORS = ("centre", "point", "branch", "normal", "force")  # of a ContactNetwork
TRANSPORT = {  # curves of grains under wind
    "transport/flux": ("flux, kg/(m s)", pictures.SAND),
    "transport/flying": ("share of the grains above the bed", pictures.EMBER),
    "transport/friction_velocity": ("friction velocity, m/s", (120, 220, 255)),
}
SCALE_SHARE = 0.8  # longest scale bar over the radius of what the camera frames [1]
SCALE_WIDTH = 0.008  # half width of the scale bar over that radius [1]
REWRITE_INTERVAL = 20  # frames after which the resting grains are chosen and written anew [1]
CREEP = 0.02  # displacement of a resting grain that is not worth writing, over its radius [1]


@dataclass(frozen=True)
class RunHeader:
    """Static content of the recording of a run."""

    name: str
    kind: str
    scene_text: str  # the scene file, TOML
    radii: Floats  # [n] m, of all grains that the run will release
    walls: tuple[WallMesh, ...] = ()
    contacts: bool = False  # whether the contact network is recorded
    fields: bool = False  # whether coarse-grained fields are


@dataclass(frozen=True)
class StaticGrains:
    """Resting grains as they were last written: at first none, due at once."""

    ident: Integers = field(default_factory=lambda: np.empty(0, np.int32))  # [k] GrainTable rows, ascending
    position: Floats = field(default_factory=lambda: np.empty((0, 3)))  # [k, 3] m
    age: int = REWRITE_INTERVAL  # frames since


@dataclass
class Recording:
    path: Path
    stream: "rr.RecordingStream"
    static_grains: StaticGrains = field(default_factory=StaticGrains)
    lock: BufferedWriter | None = None  # of the part file, held until the recording is closed


def is_disk_nearly_full(path: Path) -> bool:
    """Whether the disk of a file is so full that a recording should not grow on it."""
    return shutil.disk_usage(path.parent).free < FREE_SPACE_LEAST


def lock_part_file(part: Path) -> BufferedWriter:
    """The right to write a part file, held while what is returned stays open. Raises BadInput.

    A process that is killed holds nothing any more.
    """
    if is_disk_nearly_full(part):
        raise BadInput(f"{part}: the disk is nearly full; make room, or give --no-record")
    file = part.open("ab")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise BadInput(f"{part}: another process is writing it; give --record another FILE") from None
    except OSError:
        pass  # a file system without locks
    return file


def open_stream(path: Path, name: str, layout: "rrb.Blueprint", application: str = APPLICATION) -> Recording:
    """Begin PATH.part with its name and blueprint. Raises BadInput where the file cannot be written."""
    make_parent_folder(path)
    batches = rr.ChunkBatcherConfig(flush_tick=FLUSH_INTERVAL)
    stream = rr.RecordingStream(application, recording_id=path.stem, batcher_config=batches)
    try:
        lock = lock_part_file(part_path(path))
        stream.set_sinks(rr.FileSink(part_path(path)), default_blueprint=layout)
    except OSError as error:
        raise BadInput(f"{path}: the recording cannot be written ({error.strerror})") from error
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    stream.send_recording_name(name)
    return Recording(path, stream, lock=lock)


def open_recording(path: Path, header: RunHeader) -> Recording:
    """Begin the recording of a run with its scene, walls and names of curves. Raises BadInput."""
    focus = blueprints.choose_focus(header.kind, header.radii, header.walls)
    layout = blueprints.run_blueprint(header.kind, focus, header.contacts, header.fields)
    recording = open_stream(path, header.name, layout)
    log_scene_text(recording, header.name, header.scene_text)
    curves = CURVES | (TRANSPORT if header.kind in blueprints.WIND_KINDS else {})
    for entity, (legend, colour) in curves.items():
        log_curve_legend(recording, entity, legend, colour)
    set_recording_time(recording, 0.0, 0)
    log_surroundings(recording, header.walls, focus)
    flush_recording(recording)
    return recording


def open_view(kind: str, radii: Floats, walls: tuple[WallMesh, ...]) -> tuple[Recording, "rr.BinaryStream"]:
    """Recording in memory for a page, of walls and grains, and the stream that its bytes are read from.

    Its time is the number of the frame: a session that returns to an earlier time goes on there.
    """
    focus = blueprints.choose_focus(kind, radii, walls)
    recording = Recording(Path(), rr.RecordingStream(APPLICATION))
    out = recording.stream.binary_stream()
    recording.stream.send_blueprint(blueprints.add_time_panel(blueprints.grain_view(focus), timeline=FRAME))
    recording.stream.set_log_time_enabled(False)
    recording.stream.set_log_tick_enabled(False)
    recording.stream.set_time(FRAME, sequence=0)
    log_surroundings(recording, walls, focus)
    return recording, out


def log_view(recording: Recording, frame: int, snapshot: Snapshot, colours: NDArray[np.uint8]) -> None:
    """Write all grains as points of one entity, in order of their rows."""
    recording.stream.set_time(FRAME, sequence=frame)
    places, radii = snapshot.position.astype(np.float32), snapshot.radius.astype(np.float32)
    points = rr.Points3D.from_fields(positions=places, radii=radii, colors=colours)
    recording.stream.log(GRAINS, points)


def log_surroundings(recording: Recording, walls: tuple[WallMesh, ...], focus: blueprints.Focus) -> None:
    """Write directions, the unit of length, walls and a scale bar."""
    recording.stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.stream.log("world", rr.Transform3D(scale=blueprints.MAGNIFICATION), static=True)
    for wall in walls:
        log_wall(recording, wall)
    log_scale_bar(recording, "world/scale", focus)


def log_scale_bar(recording: Recording, entity: str, focus: blueprints.Focus) -> None:
    """Write a scale bar with its length, on the ground in front of what the camera frames; static."""
    length = 1e-3 * pictures.scale_bar_length(1e3 * SCALE_SHARE * focus.radius)
    x, y, z = focus.centre[0], focus.centre[1] - focus.radius, max(focus.centre[2] - focus.radius, 0.0)
    ends = [[x - 0.5 * length, y, z], [x + 0.5 * length, y, z]]
    label: dict[str, Any] = {"labels": [f"{1e3 * length:g} mm"], "show_labels": True}
    bar = rr.LineStrips3D([ends], radii=SCALE_WIDTH * focus.radius, colors=[pictures.CHALK], **label)
    recording.stream.log(entity, bar, static=True)


def log_colour_legend(recording: Recording, moving_speed: float) -> None:
    """Write the legend of colours: grains are drawn as moving from a speed [m s-1] on; static."""
    speeds = (moving_speed, max(FASTEST_COLOUR, 2.0 * moving_speed))
    log_image(recording, "legend", pictures.colour_legend(speeds), timeless=True)


def log_scene_text(recording: Recording, name: str, text: str) -> None:
    """Write the scene file (TOML) as a static text."""
    page = f"# {name}\n\n```toml\n{text}\n```\n"
    recording.stream.log("scene", rr.TextDocument(page, media_type=rr.MediaType.MARKDOWN), static=True)


def log_curve_legend(recording: Recording, entity: str, legend: str, colour: pictures.Colour) -> None:
    curve = rr.SeriesLines(names=legend, colors=[colour], widths=CURVE_WIDTH)
    recording.stream.log(entity, curve, static=True)


def set_recording_time(recording: Recording, time: float, step: int) -> None:
    """Set time [s] and step of everything logged from here on."""
    recording.stream.set_time(blueprints.TIMELINE, duration=time)
    recording.stream.set_time("step", sequence=step)


def log_frame(recording: Recording, snapshot: Snapshot, moving_speed: float) -> None:
    """Write the grains: static ones to world/bed when they have changed, the others to world/mobile."""
    set_recording_time(recording, snapshot.time, snapshot.step)
    recording.static_grains, is_new = update_static_grains(recording.static_grains, snapshot, moving_speed)
    resting = np.isin(snapshot.ident, recording.static_grains.ident)
    colours = pictures.grain_colours(snapshot, moving_speed, max(FASTEST_COLOUR, 2.0 * moving_speed))
    if is_new:
        log_grains(recording, "world/bed", snapshot, resting, colours[resting])
    log_grains(recording, "world/mobile", snapshot, ~resting, colours[~resting])


def update_static_grains(
    static: StaticGrains, snapshot: Snapshot, moving_speed: float
) -> tuple[StaticGrains, bool]:
    """The resting grains at this snapshot, and whether they must be written.

    Every grain is static or mobile, never both. A grain becomes mobile as soon as it is faster than
    `moving_speed` [m s-1] or has crept CREEP radii, and static only every REWRITE_INTERVAL frames: a quiet
    heap costs next to nothing.
    """
    slow = np.linalg.norm(snapshot.velocity, axis=1) <= moving_speed
    if static.age + 1 >= REWRITE_INTERVAL:
        return StaticGrains(snapshot.ident[slow], snapshot.position[slow], 0), True
    rows = np.searchsorted(snapshot.ident, static.ident)
    here = np.isin(static.ident, snapshot.ident)
    rows[~here] = 0
    crept = np.linalg.norm(snapshot.position[rows] - static.position, axis=1)
    stays = here & slow[rows] & (crept <= CREEP * snapshot.radius[rows])
    if stays.all():
        return StaticGrains(static.ident, static.position, static.age + 1), False
    return StaticGrains(static.ident[stays], snapshot.position[rows[stays]], static.age + 1), True


def log_grains(
    recording: Recording, entity: str, snapshot: Snapshot, rows: NDArray[np.bool_], colours: NDArray[np.uint8]
) -> None:
    """Write some of the grains: position, radius and colour as points, and the columns of `grain_columns`."""
    places, radii = snapshot.position[rows].astype(np.float32), snapshot.radius[rows].astype(np.float32)
    points = rr.Points3D.from_fields(positions=places, radii=radii, colors=colours)
    recording.stream.log(entity, points, rr.AnyValues(**grain_columns(snapshot, rows)))


def grain_columns(snapshot: Snapshot, rows: NDArray[np.bool_]) -> dict[str, Any]:
    """Columns of some grains beside position and radius, as Arrow arrays, which have a type even where empty.

    ident (row of the GrainTable), contacts (touching partners), kind, velocity [m s-1], spin [rad s-1],
    force [N], and the state variables of effects under EFFECT_NUMBER.
    """
    import pyarrow as pa

    vectors = {"velocity": snapshot.velocity, "spin": snapshot.spin, "force": snapshot.force}
    columns = {"ident": pa.array(snapshot.ident[rows], type=pa.int32())}
    columns["contacts"] = pa.array(snapshot.contacts[rows], type=pa.int16())
    if snapshot.kind is not None:
        columns["kind"] = pa.array(snapshot.kind[rows], type=pa.int16())
    for name, values in vectors.items():
        if values is not None:
            flat = pa.array(values[rows].ravel(), type=pa.float32())
            columns[name] = pa.FixedSizeListArray.from_arrays(flat, 3)
    for name, values in snapshot.effect_state.items():
        columns[name.replace(".", "_")] = pa.array(values[rows], type=pa.float32())
    return columns


def log_contacts(recording: Recording, network: ContactNetwork) -> None:
    """Write contacts as lines from the first body to the second, the thicker the larger the force.

    Columns: first, second, centre, point, branch [m], normal, force [N] of a ContactNetwork, names of walls.
    """
    import pyarrow as pa

    columns: dict[str, Any] = {
        name: pa.array(getattr(network, name), type=pa.int32()) for name in ("first", "second")
    }
    for name in CONTACT_VECTORS:
        flat = pa.array(getattr(network, name).ravel(), type=pa.float32())
        columns[name] = pa.FixedSizeListArray.from_arrays(flat, 3)
    size, widest = network.normal_force, 0.25 * np.linalg.norm(network.branch, axis=1)
    strips = np.stack([network.centre, network.centre - network.branch], axis=1).astype(np.float32)
    widths = widest * pictures.force_line_widths(size)
    lines = rr.LineStrips3D(strips, radii=widths, colors=pictures.force_colours(size))
    recording.stream.log(CONTACTS, lines, rr.AnyValues(**columns, walls=list(network.walls)))


def log_totals(recording: Recording, totals: Totals) -> None:
    """Write all sums of the totals, and the decades of its energies where they are positive."""
    set_recording_time(recording, totals.time, totals.step)
    entries = {name: value for name, value in asdict(totals).items() if name not in ("time", "step")}
    log_curve_values(recording, SUMS, entries)
    log_curve_values(recording, "decades", {e: log10(entries[e]) for e in DECADES if entries[e] > 0.0})


def log_curve_values(recording: Recording, folder: str, values: Mapping[str, float]) -> None:
    """Write one value to each of the curves of a folder, at the time of the latest frame."""
    for entry, value in values.items():
        recording.stream.log(f"{folder}/{entry}", rr.Scalars(value))


def log_image(recording: Recording, entity: str, picture: pictures.Picture, timeless: bool = False) -> None:
    """Write a colour picture, at the time of the latest frame or for all times."""
    image = rr.Image(np.asarray(picture), color_model="RGB").compress(jpeg_quality=JPEG_QUALITY)
    recording.stream.log(entity, image, static=timeless)


def log_text(recording: Recording, level: Literal["INFO", "WARN", "ERROR"], text: str) -> None:
    """Write a line to the log at the time of the latest frame or totals."""
    recording.stream.log("log", rr.TextLog(text, level=level))


def wall_entity(name: str) -> str:
    """Entity of a wall, its name escaped for paths."""
    return rr.new_entity_path(["world", "walls", name])


def log_wall(recording: Recording, wall: WallMesh) -> None:
    """Write a wall. One that may be removed is not static: static data cannot be cleared."""
    vertices, triangles = wall.vertices.astype(np.float32), wall.triangles.astype(np.uint32)
    colour = (*pictures.STEEL, WALL_OPACITY)
    mesh = rr.Mesh3D(vertex_positions=vertices, triangle_indices=triangles, albedo_factor=colour)
    recording.stream.log(wall_entity(wall.name), mesh, static=not wall.moving)


def log_wall_pose(recording: Recording, name: str, rotation: Floats, translation: Floats) -> None:
    """Write the pose of a wall: rotated by a matrix [3, 3], then shifted [m]."""
    recording.stream.log(wall_entity(name), rr.Transform3D(translation=translation, mat3x3=rotation))


def log_wall_removed(recording: Recording, name: str) -> None:
    """Clear a wall from now on; only one whose mesh says `moving`."""
    recording.stream.log(wall_entity(name), rr.Clear(recursive=False))


def set_run_properties(recording: Recording, group: str, values: Mapping[str, Any]) -> None:
    """Write properties of the run (groups result, scene, doe): columns of rerun's table of runs. No None."""
    properties = {name: value for name, value in values.items() if value is not None}
    if properties:
        recording.stream.send_property(group, rr.AnyValues(**properties))


def flush_recording(recording: Recording) -> None:
    """Write everything to the operating system: what was logged survives the death of this process.

    Raises BadInput where the disk takes nothing more; what it took can be read.
    """
    try:
        recording.stream.flush(timeout_sec=FLUSH_LIMIT)
    except RuntimeError:
        # the program leaves without waiting for the writer that has ended, at exit and with its stream
        atexit.unregister(rr.rerun_shutdown)
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(recording.stream))
        message = f"{part_path(recording.path)} holds the beginning"
        raise BadInput(f"{recording.path}: cannot be written to its end; {message}") from None


def close(recording: Recording, properties: Mapping[str, Mapping[str, Any]] | None = None) -> Path:
    """Write properties by group, finish the file and give it its name; closing twice does no harm."""
    for group, values in (properties or {}).items():
        set_run_properties(recording, group, values)
    part = part_path(recording.path)
    if part.exists():
        flush_recording(recording)
        recording.stream.disconnect()
        os.replace(part, recording.path)
    if recording.lock is not None:
        recording.lock.close()
    return recording.path
