"""Recordings read back as NumPy: grains, contacts and walls of every frame.

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

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Integers
from taichi_erosion.core.snapshot import FIELD_UNITS, ContactNetwork, GrainFields
from taichi_erosion.recording.blueprint import TIMELINE
from taichi_erosion.recording.stream import CONTACT_VECTORS, CONTACTS

if TYPE_CHECKING:
    import pyarrow as pa
    from rerun.chunk import Chunk

Singles = NDArray[Any]  # single precision, or double of a state that was not recorded

NANOSECOND = 1e-9  # s, unit of rerun's durations
SUFFIX = ".rrd"
MAGIC = b"RRF2"  # first bytes of a recording
HEADER_SIZE = 12  # bytes
MESSAGE_HEAD = struct.Struct("<QQ")  # kind and length
POSITION, RADIUS, COLOUR = "Points3D:positions", "Points3D:radii", "Points3D:colors"
WALLS = "/world/walls/"
VERTICES, TRIANGLES = "Mesh3D:vertex_positions", "Mesh3D:triangle_indices"
SHIFT, TURN, CLEAR = "Transform3D:translation", "Transform3D:mat3x3", "Clear:is_recursive"
END = 0  # kind of the message that closes a recording


@contextmanager
def open_whole_messages(path: Path) -> Iterator[Path]:
    """A file that rerun can read: the recording, or a copy of its whole messages where the last one is cut.

    A part file is copied too, since the viewer knows recordings by their suffix.
    """
    size = size_of_whole_messages(path)
    if size == path.stat().st_size and path.suffix == SUFFIX:
        yield path
        return
    with tempfile.TemporaryDirectory() as folder, path.open("rb") as file:
        copy = Path(folder) / (path.name.partition(SUFFIX)[0] + SUFFIX)
        copy.write_bytes(file.read(size))
        yield copy


def size_of_whole_messages(path: Path) -> int:
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

    with open_whole_messages(path) as whole:
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


def component_rows(path: Path, entity: str, component: str) -> list[tuple[int, dict[str, NDArray[Any]]]]:
    """Rows (time [ns], values by component) of an entity that hold one component, in order of time."""
    rows = []
    for chunk in read_chunks(path):
        if chunk.entity_path == "/" + entity and not chunk.is_static:
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                times = batch.column(TIMELINE).to_numpy(zero_copy_only=False).astype(np.int64).tolist()
                # data, not times or numbers of rows
                names = [f.name for f in batch.schema if (f.metadata or {}).get(b"rerun:kind") == b"data"]
                columns = zip(*(list_column_rows(batch.column(name)) for name in names), strict=True)
                tables = (dict(zip(names, row, strict=True)) for row in columns)
                rows += zip(times, tables, strict=True)
    return sorted((row for row in rows if row[1][component] is not None), key=lambda row: row[0])


def list_column_rows(column: "pa.Array") -> Iterator[Any]:
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
    beds = component_rows(path, "world/bed", POSITION)
    bed_times = [time for time, _ in beds]
    frames = []
    for time, mobile in component_rows(path, "world/mobile", POSITION):
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


def read_contacts(path: Path) -> list[ContactNetwork]:
    """Contacts of every frame, to single precision; none where the scene did not ask for them."""
    frames = []
    for time, row in component_rows(path, CONTACTS, "first"):
        walls = tuple(str(name) for name in row["walls"])
        vectors = {name: row[name].astype(np.float64) for name in CONTACT_VECTORS}
        frames.append(ContactNetwork(time * NANOSECOND, row["first"], row["second"], **vectors, walls=walls))
    return frames


def read_fields(path: Path) -> list[GrainFields]:
    """Coarse-grained profiles of every frame; none where the scene did not ask for them."""
    samples = []
    for time, row in component_rows(path, "fields", "solid_fraction"):
        at = {name: row[name] for name in "xyz" if row[name] is not None and len(row[name])}
        shape, inner = tuple(map(len, at.values())), {"velocity": (3,), "wall_force": (3,)}
        inner |= {"kinetic_stress": (3, 3), "contact_stress": (3, 3)}
        fields = {name: row[name].reshape(*shape, *inner.get(name, ())) for name in FIELD_UNITS}
        samples.append(GrainFields(time * NANOSECOND, at, float(row["width"][0]), **fields))
    return samples


@dataclass
class WallTrack:
    """A recorded wall: its shape at the start, and where it is from which time on."""

    name: str
    vertices: Singles = field(default_factory=lambda: np.zeros((0, 3), np.float32))  # [v, 3] m
    triangles: Integers = field(default_factory=lambda: np.zeros((0, 3), np.int32))
    poses: dict[int, tuple[Singles, Singles] | None] = field(default_factory=dict)  # by ns; None: removed

    def at(self, time: float) -> Singles | None:
        """Vertices at a time [s], [v, 3] m; None where the wall has been removed."""
        times = [row for row in sorted(self.poses) if row <= time / NANOSECOND + 0.5]
        pose = self.poses[times[-1]] if times else (np.eye(3, dtype=np.float32), np.zeros(3, np.float32))
        return None if pose is None else self.vertices @ pose[0].T + pose[1]


def read_walls(path: Path) -> list[WallTrack]:
    tracks: dict[str, WallTrack] = {}
    for chunk in read_chunks(path):
        if not chunk.entity_path.startswith(WALLS):
            continue
        name = chunk.entity_path.removeprefix(WALLS).replace("\\", "")
        track, batch = tracks.setdefault(name, WallTrack(name)), chunk.to_record_batch()
        columns = {key: list(list_column_rows(batch.column(key))) for key in batch.schema.names if ":" in key}
        times = [0] if chunk.is_static else batch.column(TIMELINE).to_numpy(zero_copy_only=False).astype(int)
        for place, time in enumerate(times):
            row = {key: column[place] for key, column in columns.items()}
            if row.get(VERTICES) is not None:
                track.vertices, track.triangles = row[VERTICES], row[TRIANGLES].astype(np.int32)
            if row.get(CLEAR) is not None:
                track.poses[int(time)] = None
            elif row.get(SHIFT) is not None:
                track.poses[int(time)] = row[TURN].reshape(3, 3).T, row[SHIFT][0]  # stored column by column
    return list(tracks.values())
