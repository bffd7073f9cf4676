"""Checkpoints: all arrays of a simulation in one file, whole or not at all, read back bit for bit."""

import json
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion import __version__
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import atomic_file, make_parent, regular_file

Arrays = dict[str, NDArray[Any]]

SCHEMA = "taichi_erosion checkpoint 5"  # raised when the layout of the file, or what a state holds, changes
HEAD = "head"  # member that holds the header
STATE = "state/"  # prefix of the members that hold the arrays
# what damaged archives and foreign members raise, from the zip layer up to the header
DAMAGE = (zipfile.BadZipFile, zlib.error, ValueError, KeyError, EOFError, NotImplementedError, RuntimeError)


def save_checkpoint(path: Path, state: Arrays, meta: dict[str, Any]) -> None:
    """Write arrays and what belongs to them; `meta` holds what JSON can hold, `scene_hash` among it.

    The file grows beside its place, is forced to the disk, and then takes the place in one step: a crash at
    any moment leaves the previous checkpoint.
    """
    make_parent(path)
    head = json.dumps({"schema": SCHEMA, "package_version": __version__, "meta": meta})
    members: Arrays = {HEAD: np.frombuffer(head.encode(), dtype=np.uint8)}
    members.update({STATE + name: values for name, values in state.items()})
    try:
        with atomic_file(path) as file:
            np.savez(file, allow_pickle=False, **members)
    except OSError as error:
        raise BadInput(f"{path}: the checkpoint cannot be written ({error.strerror})") from error


def is_checkpoint(path: Path) -> bool:
    """Whether a file is a checkpoint of this program, of any version."""
    try:
        with zipfile.ZipFile(regular_file(path)) as members:
            return f"{HEAD}.npy" in members.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def load_checkpoint(path: Path, scene_hash: str | None = None) -> tuple[Arrays, dict[str, Any]]:
    """Read (state, meta) of a checkpoint; with `scene_hash` only one of that scene.

    A run continues bit for bit only with the code that wrote it: another version of the package is refused.
    """
    try:
        with regular_file(path).open("rb") as file, np.load(file, allow_pickle=False) as members:
            head = json.loads(bytes(members[HEAD]).decode())
            check_head(path, head, scene_hash)
            state = {name.removeprefix(STATE): members[name] for name in members.files if name != HEAD}
    except FileNotFoundError as error:
        raise BadInput(f"{path}: no such checkpoint") from error
    except OSError as error:
        raise BadInput(f"{path}: the checkpoint cannot be read ({error.strerror or error})") from error
    except (*DAMAGE, TypeError, AttributeError) as error:
        raise BadInput(f"{path}: damaged, or not a checkpoint of taichi_erosion") from error
    return state, head["meta"]


def check_head(path: Path, head: dict[str, Any], scene_hash: str | None) -> None:
    """Raise BadInput unless this code wrote the checkpoint, for the scene wanted."""
    if head["schema"] != SCHEMA:
        raise BadInput(f"{path}: layout '{head['schema']}' cannot be read, only '{SCHEMA}'")
    if head["package_version"] != __version__:
        written = head["package_version"]
        raise BadInput(
            f"{path}: written by taichi_erosion {written}; this is {__version__}, which cannot resume it"
        )
    if scene_hash is not None and head["meta"].get("scene_hash") != scene_hash:
        raise BadInput(f"{path}: belongs to scene {head['meta'].get('scene_hash')}, not to {scene_hash}")
