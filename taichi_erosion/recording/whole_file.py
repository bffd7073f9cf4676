"""Files that exist whole or not at all."""

import os
from pathlib import Path

from taichi_erosion.core.errors import BadInput

PART_SUFFIX = ".part"  # name of a file while it is being written


def part_path(path: Path) -> Path:
    """Where a file grows until it is whole, in the same folder, so that renaming it is one step."""
    return path.with_name(path.name + PART_SUFFIX)


def make_folder(path: Path) -> None:
    """Make the folder that a file will lie in."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{path}: its folder cannot be made ({error.strerror})") from error


def write_whole(path: Path, content: bytes) -> Path:
    """Write a file so that a crash at any moment leaves the old file or the new one, never a part."""
    make_folder(path)
    part = part_path(path)
    try:
        with part.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written ({error.strerror})") from error
    return path
