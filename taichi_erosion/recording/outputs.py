"""Files of a run: whether they may be written, whether the disk has room, and who writes a recording.

A run of a scene replaces the recording, document, silhouettes and film of an earlier run of the same scene
under the same name. The document names its scene and the other files; a recording without a document, which
an interruption leaves, is known by the name of the program at its beginning.

rerun writes from a thread of its own. At the first byte that the disk refuses the thread ends, what is logged
afterwards goes nowhere, and the program would wait for that thread for ever when it leaves. A recording is
therefore closed, whole, while there still is room for the results; where the disk refuses even so, the wait
is called off.
"""

import atexit
import ctypes
import fcntl
import json
import shutil
from io import BufferedWriter
from pathlib import Path
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import REMEDY, check_writable
from taichi_erosion.recording import rr

RECORDING = ".rrd"
SUFFIXES = (RECORDING, ".json", ".png", ".gif")
HEAD = 4096  # bytes of a recording in which the name of its program stands
PROGRAM = b"taichi_erosion"
MEGABYTE = 10**6  # bytes
FREE_SPACE_LEAST = 50 * MEGABYTE  # bytes left free for documents, pictures and a checkpoint


def refuse_unwritable(output: Path, scene: Path) -> None:
    """Raise BadInput where an output cannot be written, is no file, or is the scene itself."""
    check_writable(output)
    if output.resolve() == scene.resolve():
        raise BadInput(f"{output}: is the scene itself; give another name to what is written")


def refuse_foreign_outputs(record: Path, scene: Path, force: bool = False) -> None:
    """Raise BadInput where a run cannot write its files, or would replace what none of its scene wrote."""
    refuse_unwritable(record, scene)
    if record.suffix != RECORDING:
        raise BadInput(f"{record}: is no name of a recording, which ends in {RECORDING}")
    present = [path for suffix in SUFFIXES if (path := record.with_suffix(suffix)).exists()]
    for path in present:
        refuse_unwritable(path, scene)
    if force or not present:
        return
    document = document_of(record)
    if document and Path(str(document["scene"])).name != scene.name:
        told = f"exists, and belongs to a run of {document['scene']}"
        raise BadInput(f"{record.with_suffix('.json')}: {told}; {REMEDY}")
    named = {
        Path(str(document[key])).name for key in ("recording", "silhouettes", "film") if document.get(key)
    }
    for path in present:
        own = path.name in named or (document and path.suffix == ".json") or is_recording(path)
        if not own:
            raise BadInput(f"{path}: exists, and no run of {scene} wrote it; {REMEDY}")


def document_of(record: Path) -> dict[str, Any]:
    """Document of the run beside a recording; empty where there is none of this program."""
    try:
        document = json.loads(record.with_suffix(".json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    known = (
        isinstance(document, dict)
        and "scene" in document
        and "taichi_erosion" in document.get("versions", {})
    )
    return document if known else {}


def is_recording(path: Path) -> bool:
    """Whether a file is a recording of this program."""
    if path.suffix != RECORDING or not path.is_file():
        return False
    with path.open("rb") as file:
        return PROGRAM in file.read(HEAD)


def unused_name(path: Path) -> Path:
    """The path, or the first of PATH-2, PATH-3 and so on that does not exist."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return free


def is_disk_nearly_full(path: Path) -> bool:
    """Whether the disk of a file is so full that a recording should not grow on it."""
    try:
        return shutil.disk_usage(path.parent).free < FREE_SPACE_LEAST
    except OSError:
        return False  # a file system that does not tell


def lock_part_file(part: Path) -> BufferedWriter:
    """The right to write a part file, held while what is returned stays open. Raises BadInput.

    A process that is killed holds nothing any more.
    """
    if is_disk_nearly_full(part):
        least = f"a recording leaves {FREE_SPACE_LEAST // MEGABYTE} MB free"
        raise BadInput(f"{part}: the disk is nearly full: {least}; make room, or give --no-record")
    file = part.open("ab")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise BadInput(f"{part}: another process is writing it; give --record another FILE") from None
    except OSError:
        pass  # a file system without locks
    return file


def abandon_writer(stream: Any) -> None:
    """Let the program leave without waiting for a writer that has ended: at exit, and with its stream."""
    atexit.unregister(rr.rerun_shutdown)
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))
