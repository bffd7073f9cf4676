"""Files that users name: plain ones, so that no pipe or device is waited for or read for ever.

Files that exist whole or not at all.
"""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from taichi_erosion.core.errors import BadInput

LARGEST_TEXT = 100_000_000  # bytes; nobody writes a longer table or document for this program


def plain_file(path: Path) -> Path:
    """The path, where a plain file stands. Raises OSError for a pipe, a device, a folder or nothing."""
    path.stat()
    if not path.is_file():
        raise OSError("is not a file")
    return path


def plain_text(path: Path, encoding: str = "utf-8") -> str:
    """Content of a text file. Raises OSError for no plain file or a huge one, ValueError for no text."""
    size = plain_file(path).stat().st_size
    if size > LARGEST_TEXT:
        raise OSError(f"{size} bytes are too many; at most {LARGEST_TEXT}")
    return path.read_text(encoding=encoding)


PART_SUFFIX = ".part"  # name of a file while it is being written


def part_path(path: Path) -> Path:
    """Where a file grows until it is whole, in the same folder, so that renaming it is one step."""
    return path.with_name(path.name + PART_SUFFIX)


def make_folder(path: Path) -> None:
    """Make the folder that a file will lie in. Raises BadInput where it cannot be made.

    Likewise where the name is that of a folder, a pipe or a device, which a whole file would replace.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        taken = not path.name or (path.exists() and not path.is_file())
        os.fspath(path).encode()
    except OSError as error:
        raise BadInput(f"{path}: its folder cannot be made ({error.strerror})") from error
    except ValueError:
        raise BadInput(f"{str(path)!a}: is not a name in UTF-8") from None
    if taken:
        raise BadInput(f"{path}: is not the name of a file")


def refuse_unwritable(path: Path) -> None:
    """Raise BadInput where a file cannot be made: sooner than after hours of work."""
    make_folder(path)
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            return
    except OSError as error:
        raise BadInput(f"{path}: cannot be written ({error.strerror})") from None


@contextmanager
def growing(path: Path) -> Iterator[BinaryIO]:
    """An empty file that takes its place in one step once it is whole and on the disk. Raises OSError.

    A crash at any moment leaves the old file or the new one, never a part. Two processes that write one file
    do so one after the other.
    """
    part = part_path(path)
    with alone(part) as file:
        try:
            file.truncate()
            yield file
            file.flush()
            os.fsync(file.fileno())
            os.replace(part, path)
        except BaseException:
            part.unlink(missing_ok=True)  # on a full disk the room it takes is missed elsewhere
            raise


@contextmanager
def alone(part: Path) -> Iterator[BinaryIO]:
    """A part file that no other process writes; one that was renamed while we waited for it is not it."""
    while True:
        with os.fdopen(os.open(part, os.O_RDWR | os.O_CREAT, 0o666), "r+b") as file:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(file, fcntl.LOCK_EX)
            if is_still(part, file):
                yield file
                return


def is_still(path: Path, file: BinaryIO) -> bool:
    """Whether an open file still lies under its name."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


def write_whole(path: Path, content: bytes) -> Path:
    """Write a file so that a crash at any moment leaves the old file or the new one, never a part."""
    make_folder(path)
    try:
        with growing(path) as file:
            file.write(content)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written ({error.strerror})") from error
    return path
