"""Display of results in notebooks and terminals: progress, tables, HTML of sentences and tables."""

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from html import escape
from shutil import get_terminal_size
from typing import Any

import pandas as pd
from rich.console import Console
from rich.progress import Progress

Report = Callable[[float, str], None]  # (share done [1], words)


@contextmanager
def progress_bar(title: str) -> Iterator[Report]:
    """Context with a progress function: a bar in a terminal or a notebook, nothing where stderr is a file."""
    console = Console(stderr=True)
    if not (sys.stderr.isatty() or console.is_jupyter):
        yield lambda share, words: None
        return
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share, words: bar.update(task, completed=share, description=f"{title}: {words}")


def result_html(title: str, sentences: Iterable[str], tables: Iterable[pd.DataFrame]) -> str:
    """HTML of a result: title, sentences, tables."""
    parts = [f"<p><b>{escape(title)}</b></p>", *(f"<p>{escape(one)}</p>" for one in sentences)]
    html = [table.to_html(border=0, na_rep="", float_format="{:.4g}".format) for table in tables]
    return "\n".join([*parts, *html])


class WholeTable(pd.DataFrame):
    """A DataFrame whose text has every column and every word; what is too wide goes on below."""

    @property
    def _constructor(self) -> type["WholeTable"]:
        return WholeTable

    def __repr__(self) -> str:
        whole = ("display.max_columns", None, "display.max_colwidth", None)
        with pd.option_context(*whole, "display.width", get_terminal_size().columns):
            return super().__repr__()


def table_of_rows(rows: Iterable[dict[str, Any]], columns: Sequence[str] = ()) -> WholeTable:
    """Table of rows; `columns` are those of a table without rows."""
    records = list(rows)
    return WholeTable(records) if records else WholeTable(columns=list(columns))
