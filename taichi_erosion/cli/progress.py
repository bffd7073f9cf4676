"""The log that `--log FILE` asks for: the order, progress, warnings and the end, each with its time.

How far a long command is: a bar on a terminal, else a line now and then; on stderr either way.
"""

import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

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


LINE_INTERVAL = 10.0  # s between two lines where stderr is no terminal
KNOWN_AFTER = 5.0  # s after which the pace says something about the rest
KNOWN_FROM = 0.02  # share done from which it does [1]
MINUTE = 60.0  # s

Report = Callable[[float, str], None]  # (share done [1], what is going on, in a few words)


@contextmanager
def reporting(title: str) -> Iterator[Report]:
    """A function to call with the share done and a few words; what it shows ends with the block."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield report_by_lines(
            title, lambda line: console.print(line, markup=False, highlight=False, soft_wrap=True)
        )
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    log = report_by_lines(title, lambda _: None)
    with Progress(*columns, console=console, transient=True, redirect_stdout=False) as bar:
        task = bar.add_task(title, total=1.0)

        def report(share: float, words: str) -> None:
            bar.update(task, completed=share, description=f"{title}: {words}")
            log(share, words)

        yield report


def report_by_lines(title: str, show: Callable[[str], None]) -> Report:
    """Show and log a line every LINE_INTERVAL seconds, so that a log shows life and stays short."""
    began = last = monotonic()

    def report(share: float, words: str) -> None:
        nonlocal last
        now = monotonic()
        if now - last >= LINE_INTERVAL:
            last = now
            # a campaign knows better: it counts what its runs have cost so far
            rest = "" if words.endswith(" left") else time_left(share, now - began)
            line = f"{title}: {share:.0%}, {words}{rest}"
            LOG.info(line)
            show(line)

    return report


def time_left(share: float, elapsed: float) -> str:
    """What the rest takes at the pace so far,  t (1 - s) / s;  nothing is said before that pace is known."""
    if share < KNOWN_FROM or elapsed < KNOWN_AFTER:
        return ""
    left = elapsed * (1.0 - share) / share
    return f", about {left:.0f} s left" if left < MINUTE else f", about {left / MINUTE:.0f} min left"
