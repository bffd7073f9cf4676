"""Progress of a command on stderr (a bar; lines where stderr is no terminal), and the log of `--log FILE`."""

import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import timedelta
from pathlib import Path
from time import monotonic

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from taichi_erosion.core.errors import BadInput, ExitCode

LOG = logging.getLogger("taichi_erosion")
LAYOUT = "%(asctime)s %(levelname)s %(message)s"
LOG.addHandler(logging.NullHandler())  # without --log there is no output
LOG.propagate = False


def open_log(path: Path) -> None:
    """Start appending to a log file. Raises BadInput where it cannot be written."""
    try:
        handler = logging.FileHandler(path, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"--log {path}: cannot be written ({error.strerror})") from None
    handler.setFormatter(logging.Formatter(LAYOUT))
    handler.handleError = lambda record: stop_log_after_error(handler)
    LOG.setLevel(logging.INFO)
    LOG.addHandler(handler)


def stop_log_after_error(handler: logging.FileHandler) -> None:
    """Stop logging after a write error; the command continues."""
    LOG.removeHandler(handler)
    sys.stderr.write(f"--log {handler.baseFilename}: cannot be written ({sys.exception()}); end of log\n")
    with suppress(OSError):
        handler.close()


def close_log() -> None:
    for handler in LOG.handlers:
        if isinstance(handler, logging.FileHandler):
            LOG.removeHandler(handler)
            handler.close()


SHOWN_AFTER = 3.0  # s, below which a command shows no progress
LINE_INTERVAL = 10.0  # s between two lines
PACE_WINDOW = 86_400.0  # s over which the pace is taken, from which the remaining time follows

KEPT = "finished runs are kept, the same command continues"  # after Ctrl-C

Report = Callable[[float, str], None]  # (share done [1], short text)


@contextmanager
def progress_report(title: str, reassurance: str = "") -> Iterator[Report]:
    """Context with a progress function: a bar after SHOWN_AFTER seconds, or a line every LINE_INTERVAL.

    Ctrl-C ends the program with a line on what is kept.
    """
    console = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn()
    bar = Progress(*columns, console=console, transient=True, speed_estimate_period=PACE_WINDOW)
    task = bar.add_task(title, total=1.0)
    began = last = monotonic()

    def report(share: float, words: str) -> None:
        nonlocal last
        now = monotonic()
        bar.update(task, completed=share, description=f"{title}: {words}")
        if console.is_terminal and now - began > SHOWN_AFTER:
            bar.start()
        if now - last >= LINE_INTERVAL:
            last = now
            remaining = bar.tasks[task].time_remaining
            line = f"{title}: {share:.0%}, {words}"
            line += "" if remaining is None else f", about {timedelta(seconds=round(remaining))} left"
            LOG.info(line)
            if not console.is_terminal:
                console.print(line, markup=False, highlight=False, soft_wrap=True)

    try:
        yield report
    except KeyboardInterrupt as interrupt:
        text = str(interrupt) or reassurance
        announce(f"interrupted; {text}" if text else "interrupted")
        raise typer.Exit(ExitCode.INTERRUPTED) from None
    finally:
        if console.is_terminal:
            bar.stop()


def announce(line: str) -> None:
    """Print a line on stderr and write it to the log."""
    LOG.info(line)
    typer.echo(line, err=True)
