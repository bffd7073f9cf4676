"""Recordings read back as NumPy, or as files for ParaView: one VTK file a frame, and a list of frames.

Those of killed runs too, which rerun refuses: their last message is cut.

A recording is a header of 12 bytes, then messages: kind and length as 64-bit little-endian integers, then as
many bytes as the length says. A message of kind END closes it, and only a footer follows. This is the layout
that rerun 0.41 writes; the tests hold it against whole recordings.
"""

import struct
import tempfile
import warnings
from bisect import bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import mark_of, refuse_foreign, write_atomic
from taichi_erosion.recording.blueprint import TIMELINE

if TYPE_CHECKING:
    import pyarrow as pa
    from rerun.chunk import Chunk

Singles = NDArray[np.float32]
Integers = NDArray[np.int32]

NANOSECOND = 1e-9  # s, unit of rerun's durations
SUFFIX = ".rrd"
MAGIC = b"RRF2"  # first bytes of a recording
HEADER_SIZE = 12  # bytes
MESSAGE_HEAD = struct.Struct("<QQ")  # kind and length
POSITION, RADIUS, COLOUR = "Points3D:positions", "Points3D:radii", "Points3D:colors"
COLLECTION = "grains.pvd"  # list of the frames for ParaView
END = 0  # kind of the message that closes a recording


@contextmanager
def readable(path: Path) -> Iterator[Path]:
    """A file that rerun can read: the recording, or a copy of its whole messages where the last one is cut.

    A part file is copied too, since the viewer knows recordings by their suffix.
    """
    size = whole_size(path)
    if size == path.stat().st_size and path.suffix == SUFFIX:
        yield path
        return
    with tempfile.TemporaryDirectory() as folder, path.open("rb") as file:
        copy = Path(folder) / (path.name.partition(SUFFIX)[0] + SUFFIX)
        copy.write_bytes(file.read(size))
        yield copy


def whole_size(path: Path) -> int:
    """Bytes up to the end of the last whole message; of a closed recording, all of them."""
    if not path.is_file():
        raise BadInput(f"{path}: no such recording")
    total = path.stat().st_size
    with path.open("rb") as file:
        if not file.read(HEADER_SIZE).startswith(MAGIC):
            raise BadInput(f"{path}: not a recording (.rrd)")
        whole = HEADER_SIZE
        while len(head := file.read(MESSAGE_HEAD.size)) == MESSAGE_HEAD.size:
            kind, length = MESSAGE_HEAD.unpack(head)
            end = whole + MESSAGE_HEAD.size + length
            if end > total:
                return whole
            if kind == END:
                return total
            whole = file.seek(end)
    return whole


@dataclass(frozen=True)
class GrainFrame:
    """All released grains at one moment, ordered by their row in the GrainTable."""

    time: float  # s
    ident: Integers  # [n]
    position: Singles  # [n, 3] m; of a static grain to within stream.CREEP of its radius
    radius: Singles  # [n] m
    # by name, [n] or [n, 3]: the other columns of `stream.grain_columns`, of a static grain as last written
    state: dict[str, NDArray[Any]] = field(default_factory=dict)


def read_chunks(path: Path) -> Iterator["Chunk"]:
    """Whole chunks of the recording in a file, without its blueprint.

    Raises BadInput where rerun finds a message damaged.
    """
    from rerun.chunk import RrdReader

    with readable(path) as whole:
        try:
            with warnings.catch_warnings():
                # what a killed writer leaves has no footer, and is no legacy format
                warnings.filterwarnings("ignore", "RRD file has no footer")
                reader = RrdReader(whole)
            if reader.recordings():  # none when the writer died within the blueprint
                yield from reader.stream()
        except RuntimeError as damage:
            reason = str(damage).partition(": ")[2].splitlines()[0]
            raise BadInput(f"{path}: the recording is damaged ({reason})") from None


def read_rows(path: Path, entity: str, component: str) -> list[tuple[int, dict[str, NDArray[Any]]]]:
    """Rows (time [ns], values by component) of an entity that hold one component, in order of time."""
    rows = []
    for chunk in read_chunks(path):
        if chunk.entity_path == "/" + entity and not chunk.is_static:
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                times = batch.column(TIMELINE).to_numpy(zero_copy_only=False).astype(np.int64).tolist()
                # data, not times or numbers of rows
                names = [f.name for f in batch.schema if (f.metadata or {}).get(b"rerun:kind") == b"data"]
                columns = zip(*(values(batch.column(name)) for name in names), strict=True)
                tables = (dict(zip(names, row, strict=True)) for row in columns)
                rows += zip(times, tables, strict=True)
    return sorted((row for row in rows if row[1][component] is not None), key=lambda row: row[0])


def values(column: "pa.Array") -> Iterator[Any]:
    """Every row of a list column as one array, vectors as its rows; None where nothing was logged."""
    import pyarrow as pa

    for row in column:
        inner = row.values
        if inner is None:
            yield None
        elif pa.types.is_fixed_size_list(inner.type):
            yield inner.flatten().to_numpy(zero_copy_only=False).reshape(-1, inner.type.list_size)
        else:
            yield inner.to_numpy(zero_copy_only=False)


def read_grains(path: Path) -> list[GrainFrame]:
    """Every frame of a run, static and mobile grains put together."""
    beds = read_rows(path, "world/bed", POSITION)
    bed_times = [time for time, _ in beds]
    frames = []
    for time, mobile in read_rows(path, "world/mobile", POSITION):
        latest = bisect_right(bed_times, time) - 1
        if latest < 0:
            continue  # the bed of this frame was lost with the killed writer
        bed = beds[latest][1]
        order = np.argsort(np.concatenate([bed["ident"], mobile["ident"]]))
        columns = {name: np.concatenate([bed[name], mobile[name]])[order] for name in mobile}
        del columns[COLOUR]
        ident, position, radius = (columns.pop(name) for name in ("ident", POSITION, RADIUS))
        frames.append(GrainFrame(time * NANOSECOND, ident, position, radius, columns))
    return frames


def export_vtk(recording: Path, folder: Path, force: bool = False) -> Path:
    """Write every frame of a recording as points with all their columns; returns the list of frames.

    Open the list in ParaView and draw the points as spheres scaled by `radius` [m]. Raises BadInput where the
    recording holds no frame, the folder cannot be written, or it holds frames of something else.
    """
    refuse_foreign(folder / COLLECTION, recording, force)
    if not force and not (folder / COLLECTION).exists() and any(folder.glob("grains_*.vtu")):
        raise BadInput(
            f"{folder}: holds grains_*.vtu of something else; name another folder, or give --force"
        )
    frames = read_grains(recording)
    if not frames:
        raise BadInput(f"{recording}: holds no frame of grains")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        names = [write_frame(frame, folder, number) for number, frame in enumerate(frames)]
    except OSError as error:
        raise BadInput(f"{folder}: cannot be written ({error.strerror})") from None
    return write_collection(folder, names, [frame.time for frame in frames], recording)


def write_frame(frame: GrainFrame, folder: Path, number: int) -> str:
    """Write one frame; returns the name of its file."""
    import meshio

    name = f"grains_{number:05d}.vtu"
    points = np.arange(len(frame.ident))[:, None]
    columns = {"radius": frame.radius, "ident": frame.ident, **frame.state}
    meshio.Mesh(frame.position, [("vertex", points)], point_data=columns).write(folder / name, "vtu")
    return name


def write_collection(folder: Path, names: list[str], times: list[float], recording: Path) -> Path:
    """List of frames with their times, marked by the recording."""
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    for name, time in zip(names, times, strict=True):
        ElementTree.SubElement(collection, "DataSet", timestep=f"{time:.9g}", part="0", file=name)
    root.insert(0, ElementTree.Comment(f" {mark_of(folder / COLLECTION, recording)} "))
    return write_atomic(folder / COLLECTION, ElementTree.tostring(root, xml_declaration=True))
