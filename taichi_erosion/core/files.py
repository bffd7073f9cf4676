"""Files that users name: reading of regular files only, and atomic writing (whole or not at all)."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from taichi_erosion.core.errors import BadInput

LARGEST_TEXT = 100_000_000  # bytes, beyond any table or document of this program
PART_SUFFIX = ".part"  # name of a file while it is being written


def regular_file(path: Path) -> Path:
    """The path of a regular file. Raises OSError for a pipe, a device, a folder or nothing."""
    path.stat()
    if not path.is_file():
        raise OSError("is not a file")
    return path


def read_text_file(path: Path, encoding: str = "utf-8") -> str:
    """Content of a text file. Raises OSError for no regular file or a huge one, ValueError for no text."""
    size = regular_file(path).stat().st_size
    if size > LARGEST_TEXT:
        raise OSError(f"{size} bytes are too many; at most {LARGEST_TEXT}")
    return path.read_text(encoding=encoding)


def part_path(path: Path) -> Path:
    """Path of the unfinished file, in the same folder, so that renaming it is one step."""
    return path.with_name(path.name + PART_SUFFIX)


def make_parent(path: Path) -> None:
    """Make the parent folder of a file.

    Raises BadInput where it cannot be made, and where the path is that of a folder, a pipe or a device.
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


def check_writable(path: Path) -> None:
    """Raise BadInput where a file cannot be made."""
    make_parent(path)
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            return
    except OSError as error:
        raise BadInput(f"{path}: cannot be written ({error.strerror})") from None


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Empty file that replaces the one at a path in one step once it is flushed to disk. Raises OSError.

    A crash at any moment leaves the old file or the new one, never a part; concurrent writers take turns.
    """
    part = part_path(path)
    with locked(part) as file:
        try:
            file.truncate()
            yield file
            file.flush()
            os.fsync(file.fileno())
            os.replace(part, path)
        except BaseException:
            part.unlink(missing_ok=True)  # frees its space on a full disk
            raise


@contextmanager
def locked(part: Path) -> Iterator[BinaryIO]:
    """Unfinished file under an exclusive lock; opened again if it was renamed while the lock was awaited."""
    while True:
        with os.fdopen(os.open(part, os.O_RDWR | os.O_CREAT, 0o666), "r+b") as file:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(file, fcntl.LOCK_EX)
            if part.exists() and os.path.samestat(os.fstat(file.fileno()), part.stat()):
                yield file
                return


def write_atomic(path: Path, content: bytes) -> Path:
    """Write a file as `atomic_file` does. Raises BadInput where it cannot be written."""
    make_parent(path)
    try:
        with atomic_file(path) as file:
            file.write(content)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written ({error.strerror})") from error
    return path
