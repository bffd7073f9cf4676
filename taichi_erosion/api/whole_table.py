"""Table that prints all of its columns, however narrow the terminal is."""

from shutil import get_terminal_size

import pandas as pd


class WholeTable(pd.DataFrame):
    """A DataFrame whose text has every column and every word; what is too wide goes on below."""

    @property
    def _constructor(self) -> type["WholeTable"]:
        return WholeTable

    def __repr__(self) -> str:
        whole = ("display.max_columns", None, "display.max_colwidth", None)
        with pd.option_context(*whole, "display.width", get_terminal_size().columns):
            return super().__repr__()
