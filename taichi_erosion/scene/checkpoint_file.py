"""Files of checkpoints: arrays of a device and what belongs to them, read back bit for bit."""

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion import __version__
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import atomic_file, make_parent_folder, require_regular_file

# the number is raised when the layout of the file, or what a state holds, changes
SCHEMA = f"checkpoint 11 of taichi_erosion {__version__}"
HEAD = "head"  # member that holds the header
STATE = "state/"  # prefix of the members that hold the arrays

Arrays = dict[str, NDArray[Any]]


def save_checkpoint(path: Path, state: Arrays, meta: dict[str, Any]) -> None:
    """Write arrays and what belongs to them; `meta` holds what JSON can hold, `scene_hash` among it.

    The file grows beside its place, is forced to the disk, and then takes the place in one step: a crash at
    any moment leaves the previous checkpoint.
    """
    make_parent_folder(path)
    head = json.dumps({"schema": SCHEMA, "meta": meta})
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
        with zipfile.ZipFile(require_regular_file(path)) as members:
            return f"{HEAD}.npy" in members.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def load_checkpoint(path: Path) -> tuple[Arrays, dict[str, Any]]:
    """Read (state, meta) of a checkpoint.

    A run continues bit for bit only with the code that wrote it: another version of the package is refused.
    """
    try:
        with require_regular_file(path).open("rb") as file, np.load(file, allow_pickle=False) as members:
            head = json.loads(bytes(members[HEAD]).decode())
            schema, meta = head["schema"], dict(head["meta"])
            state = {name.removeprefix(STATE): members[name] for name in members.files if name != HEAD}
    except OSError as error:
        raise BadInput(f"{path}: the checkpoint cannot be read ({error.strerror or error})") from error
    except Exception as error:  # zip, zlib, numpy and JSON have an error each for what is damaged or foreign
        raise BadInput(f"{path}: damaged, or not a checkpoint of taichi_erosion") from error
    if schema != SCHEMA:
        raise BadInput(f"{path}: is '{schema}', which cannot be resumed as '{SCHEMA}'")
    return state, meta
