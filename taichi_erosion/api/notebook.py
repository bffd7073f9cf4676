"""Display of results in notebooks and terminals: progress, HTML of sentences and tables, figures."""

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

Report = Callable[[float, str], None]  # (share done [1], words)


@contextmanager
def progress(title: str) -> Iterator[Report]:
    """Context with a progress function: a bar in a terminal or a notebook, nothing where stderr is a file."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    if not (sys.stderr.isatty() or console.is_jupyter):
        yield lambda share, words: None
        return
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share, words: bar.update(task, completed=share, description=f"{title}: {words}")


def html(title: str, sentences: Iterable[str], tables: Iterable["pd.DataFrame"]) -> str:
    """HTML of a result: title, sentences, tables."""
    parts = [f"<p><b>{escape(title)}</b></p>", *(f"<p>{escape(one)}</p>" for one in sentences)]
    return "\n".join(
        [*parts, *(table.to_html(border=0, na_rep="", float_format="{:.4g}".format) for table in tables)]
    )


def frame(
    rows: Iterable[dict[str, Any]], units: dict[str, str] | None = None, columns: Sequence[str] = ()
) -> "pd.DataFrame":
    """Table of rows, which prints whole; `.attrs["units"]` has the unit of every column that has one.

    `columns` are those of a table without rows.
    """
    from taichi_erosion.api.whole_table import WholeTable

    stated = list(rows)
    table = WholeTable(stated) if stated else WholeTable(columns=list(columns))
    table.attrs["units"] = {name: unit for name, unit in (units or {}).items() if name in table.columns}
    return table
