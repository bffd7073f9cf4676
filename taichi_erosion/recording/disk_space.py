"""What a recording needs of the disk: room, and no other writer.

rerun writes from a thread of its own. At the first byte that the disk refuses the thread ends, what is logged
afterwards goes nowhere, and the program would wait for that thread for ever when it leaves. A recording is
therefore closed, whole, while there still is room for the results; where the disk refuses even so, the wait
is called off.
"""

import atexit
import ctypes
import fcntl
import shutil
from io import BufferedWriter
from pathlib import Path
from typing import Any

from taichi_erosion.core.errors import BadInput

MEGABYTE = 10**6  # bytes
FREE_SPACE_LEAST = 50 * MEGABYTE  # bytes left free for documents, pictures and a checkpoint


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
    import rerun

    atexit.unregister(rerun.rerun_shutdown)
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))
