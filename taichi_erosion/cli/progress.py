"""How far a long command is: a bar on a terminal, else a line now and then; on stderr either way."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

LINE_INTERVAL = 10.0  # s between two lines where stderr is no terminal

Report = Callable[[float, str], None]  # (share done [1], what is going on, in a few words)


@contextmanager
def reporting(title: str) -> Iterator[Report]:
    """A function to call with the share done and a few words; what it shows ends with the block."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield report_by_lines(console, title)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, redirect_stdout=False) as bar:
        task = bar.add_task(title, total=1.0)

        def report(share: float, words: str) -> None:
            bar.update(task, completed=share, description=f"{title}: {words}")

        yield report


def report_by_lines(console: Console, title: str) -> Report:
    """Report by a line every LINE_INTERVAL seconds, so that a log shows life and stays short."""
    last = monotonic()

    def report(share: float, words: str) -> None:
        nonlocal last
        if monotonic() - last >= LINE_INTERVAL:
            last = monotonic()
            console.print(f"{title}: {share:.0%}, {words}", markup=False, highlight=False, soft_wrap=True)

    return report
