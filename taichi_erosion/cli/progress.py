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


LINE_INTERVAL = 10.0  # s between two lines
ESTIMATE_AFTER = 5.0  # s before the remaining time is estimated
ESTIMATE_FROM = 0.005  # share done from which it is [1]
ESTIMATE_INTERVAL = 2.0  # s between two estimates
SETTLED = 0.1  # share done from which an estimate is at most `JUMP` times the one before, or 1 / `JUMP`
JUMP = 2.0
MINUTE, HOUR = 60.0, 3600.0  # s

KEPT = "finished runs are kept, the same command continues"  # after Ctrl-C

Report = Callable[[float, str], None]  # (share done [1], short text)


@contextmanager
def reporting(title: str) -> Iterator[Report]:
    """Context with a progress function; its bar disappears at the end of the block."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield report_by_lines(
            title, lambda line: console.print(line, markup=False, highlight=False, soft_wrap=True)
        )
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[left]}"),
    )
    countdown = Countdown(monotonic())
    log = report_by_lines(title, lambda _: None)
    with Progress(*columns, console=console, transient=True, redirect_stdout=False) as bar:
        task = bar.add_task(title, total=1.0, left="")

        def report(share: float, words: str) -> None:
            left = left_words(countdown.seconds(share, monotonic()))
            bar.update(task, completed=share, description=f"{title}: {words}", left=left)
            log(share, words)

        yield report


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


def report_by_lines(title: str, show: Callable[[str], None]) -> Report:
    """Progress function that shows and logs a line every LINE_INTERVAL seconds."""
    last = monotonic()
    countdown = Countdown(last)

    def report(share: float, words: str) -> None:
        nonlocal last
        now = monotonic()
        countdown.begin(share, now)
        if now - last >= LINE_INTERVAL:
            last, left = now, left_words(countdown.seconds(share, now))
            line = f"{title}: {share:.0%}, {words}" + (f", {left}" if left else "")
            LOG.info(line)
            show(line)

    return report


@dataclass
class Countdown:
    """Remaining time of work whose share is reported, from the pace since its first report.

        t (1 - s) / (s - s_0)

    with t the time since the first report, s the share done and s_0 the share that was done then. From
    `SETTLED` on, an estimate is at most twice the one before, and at least half of it.
    """

    began: float  # s, by a steady clock
    first: float | None = None  # share that was done at the first report
    made: float = 0.0  # s, when the last estimate was made
    estimate: float | None = None  # s

    def begin(self, share: float, now: float) -> float:
        """Share that was done at the first report, which begins the count."""
        if self.first is None:
            self.began, self.first = now, share
        return self.first

    def seconds(self, share: float, now: float) -> float | None:
        """Remaining time [s], bounded by the last one shown; None before there is an estimate."""
        first = self.begin(share, now)
        gained, elapsed = share - first, now - self.began
        if gained < ESTIMATE_FROM or elapsed < ESTIMATE_AFTER or share >= 1.0:
            return None
        if self.estimate is None or now - self.made >= ESTIMATE_INTERVAL:
            found = elapsed * max(1.0 - share, 0.0) / gained
            if self.estimate is not None and share > SETTLED:
                found = min(max(found, self.estimate / JUMP), self.estimate * JUMP)
            self.made, self.estimate = now, found
        return self.estimate


def left_words(seconds: float | None) -> str:
    """A remaining time in words; "" where it is not known."""
    if seconds is None:
        return ""
    if seconds < 1.5 * MINUTE:
        return f"about {seconds:.0f} s left"
    if seconds < 1.5 * HOUR:
        return f"about {seconds / MINUTE:.0f} min left"
    return f"about {seconds / HOUR:.1f} h left"
