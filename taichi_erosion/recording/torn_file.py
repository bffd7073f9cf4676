"""Recordings whose writer died, made readable: rerun reads nothing of a file whose last message is cut.

A recording is a header of 12 bytes, then messages: kind and length as 64-bit little-endian integers, then as
many bytes as the length says. A message of kind END closes it, and only a footer follows. This is the layout
that rerun 0.41 writes; the tests hold it against whole recordings.
"""

import struct
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from taichi_erosion.core.errors import BadInput

SUFFIX = ".rrd"
MAGIC = b"RRF2"  # first bytes of a recording
HEADER_SIZE = 12  # bytes
MESSAGE_HEAD = struct.Struct("<QQ")  # kind and length
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
