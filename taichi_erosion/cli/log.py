"""The log that `--log FILE` asks for: the order, progress, warnings and the end, each with its time."""

import logging
from pathlib import Path

from taichi_erosion.core.errors import BadInput

LOG = logging.getLogger("taichi_erosion")
LAYOUT = "%(asctime)s %(levelname)s %(message)s"
LOG.addHandler(logging.NullHandler())  # without --log nothing is said here
LOG.propagate = False


def open_log(path: Path) -> None:
    """Write to the end of a file from now on. Raises BadInput where it cannot be written."""
    try:
        handler = logging.FileHandler(path, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"--log {path}: cannot be written ({error.strerror})") from None
    handler.setFormatter(logging.Formatter(LAYOUT))
    LOG.setLevel(logging.INFO)
    LOG.addHandler(handler)


def close_log() -> None:
    """Close the file, if there is one."""
    for handler in LOG.handlers:
        if isinstance(handler, logging.FileHandler):
            LOG.removeHandler(handler)
            handler.close()
