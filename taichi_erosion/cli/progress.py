"""Progress of a command on stderr (a bar; lines where stderr is no terminal), and the log of `--log FILE`."""

import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

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
    handler.handleError = lambda record: end_log(handler)
    LOG.setLevel(logging.INFO)
    LOG.addHandler(handler)


def end_log(handler: logging.FileHandler) -> None:
    """Stop logging after a write error; the command continues."""
    LOG.removeHandler(handler)
    sys.stderr.write(f"--log {handler.baseFilename}: cannot be written ({sys.exception()}); end of log\n")
    with suppress(OSError):
        handler.close()


def close_log() -> None:
    """Close the log file, if any."""
    for handler in LOG.handlers:
        if isinstance(handler, logging.FileHandler):
            LOG.removeHandler(handler)
            handler.close()


SHOWN_AFTER = 3.0  # s, below which a command shows no progress
LINE_INTERVAL = 10.0  # s between two lines
ESTIMATE_AFTER = 5.0  # s before the remaining time is estimated
ESTIMATE_FROM = 0.005  # share done from which it is [1]
MINUTE, HOUR = 60.0, 3600.0  # s

KEPT = "finished runs are kept, the same command continues"  # after Ctrl-C

Report = Callable[[float, str], None]  # (share done [1], short text)


@contextmanager
def reporting(title: str) -> Iterator[Report]:
    """Context with a progress function: a bar after SHOWN_AFTER seconds, or a line every LINE_INTERVAL."""
    console = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn()
    bar = Progress(*columns, TextColumn("{task.fields[left]}"), console=console, transient=True)
    task, began = bar.add_task(title, total=1.0, left=""), monotonic()
    countdown, last = Countdown(began), began

    def report(share: float, words: str) -> None:
        nonlocal last
        now = monotonic()
        left = left_words(countdown.seconds(share, now))
        bar.update(task, completed=share, description=f"{title}: {words}", left=left)
        if console.is_terminal and now - began > SHOWN_AFTER:
            bar.start()
        if now - last >= LINE_INTERVAL:
            last = now
            line = f"{title}: {share:.0%}, {words}" + (f", {left}" if left else "")
            LOG.info(line)
            if not console.is_terminal:
                console.print(line, markup=False, highlight=False, soft_wrap=True)

    try:
        yield report
    finally:
        if console.is_terminal:
            bar.stop()


@contextmanager
def interruptible(title: str, kept: str = "") -> Iterator[Report]:
    """Context of `reporting` in which Ctrl-C ends the program with a line on what is kept."""
    try:
        with reporting(title) as report:
            yield report
    except KeyboardInterrupt as interrupt:
        text = str(interrupt) or kept
        typer.echo(f"interrupted; {text}" if text else "interrupted", err=True)
        raise typer.Exit(ExitCode.INTERRUPTED) from None


def announce(line: str) -> None:
    """Print a line before the work on stderr and write it to the log."""
    LOG.info(line)
    typer.echo(line, err=True)


@dataclass
class Countdown:
    """Remaining time of work, t (1 - s) / (s - s_0), from the pace since the first report.

    t is the time since then, s the share done, s_0 the share that was done then.
    """

    began: float  # s, by a steady clock
    first: float | None = None  # share that was done at the first report

    def seconds(self, share: float, now: float) -> float | None:
        """Remaining time [s]; None before there is an estimate."""
        if self.first is None:
            self.began, self.first = now, share
        gained, elapsed = share - self.first, now - self.began
        if gained < ESTIMATE_FROM or elapsed < ESTIMATE_AFTER or share >= 1.0:
            return None
        return elapsed * (1.0 - share) / gained


def left_words(seconds: float | None) -> str:
    """A remaining time in words; "" where it is not known."""
    if seconds is None:
        return ""
    if seconds < 1.5 * MINUTE:
        return f"about {seconds:.0f} s left"
    if seconds < 1.5 * HOUR:
        return f"about {seconds / MINUTE:.0f} min left"
    return f"about {seconds / HOUR:.1f} h left"
