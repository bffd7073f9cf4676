"""Progress of a command on stderr (a bar; lines where stderr is no terminal), and the log of `--log FILE`."""

import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
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
ESTIMATE_FROM = 0.02  # share done from which it is [1]
MINUTE = 60.0  # s

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
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    log = report_by_lines(title, lambda _: None)
    with Progress(*columns, console=console, transient=True, redirect_stdout=False) as bar:
        task = bar.add_task(title, total=1.0)

        def report(share: float, words: str) -> None:
            bar.update(task, completed=share, description=f"{title}: {words}")
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


def report_by_lines(title: str, show: Callable[[str], None]) -> Report:
    """Progress function that shows and logs a line every LINE_INTERVAL seconds."""
    began = last = monotonic()

    def report(share: float, words: str) -> None:
        nonlocal last
        now = monotonic()
        if now - last >= LINE_INTERVAL:
            last = now
            # a campaign gives its own estimate, from the cost of its runs
            rest = "" if words.endswith(" left") else time_left(share, now - began)
            line = f"{title}: {share:.0%}, {words}{rest}"
            LOG.info(line)
            show(line)

    return report


def time_left(share: float, elapsed: float) -> str:
    """Remaining time at the rate so far,  t (1 - s) / s;  "" before the estimate is reliable."""
    if share < ESTIMATE_FROM or elapsed < ESTIMATE_AFTER:
        return ""
    left = elapsed * (1.0 - share) / share
    return f", about {left:.0f} s left" if left < MINUTE else f", about {left / MINUTE:.0f} min left"
