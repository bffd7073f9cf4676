"""The log that `--log FILE` asks for: the order, progress, warnings and the end, each with its time."""

import logging
import sys
from contextlib import suppress
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
    handler.handleError = lambda record: end_log(handler)
    LOG.setLevel(logging.INFO)
    LOG.addHandler(handler)


def end_log(handler: logging.FileHandler) -> None:
    """Write no more where the disk refuses it: the command goes on, and its log ends here."""
    LOG.removeHandler(handler)
    sys.stderr.write(f"--log {handler.baseFilename}: cannot be written ({sys.exception()}); it ends here\n")
    with suppress(OSError):
        handler.close()


def close_log() -> None:
    """Close the file, if there is one."""
    for handler in LOG.handlers:
        if isinstance(handler, logging.FileHandler):
            LOG.removeHandler(handler)
            handler.close()
