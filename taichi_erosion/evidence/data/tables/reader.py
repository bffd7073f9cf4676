"""A table of measurements, read once: cells, the meaning of its columns, rows; all its faults at once."""

from dataclasses import replace
from pathlib import Path

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.tables.interview import (
    Interview,
    TableWishes,
    scatter_is_error,
    understood,
    upright,
)
from taichi_erosion.evidence.data.tables.rows import Faults, Table, is_tidy, table_of, tidy_columns
from taichi_erosion.evidence.data.tables.spreadsheet import read_cells


def read_rows(
    path: Path, name: str, wishes: TableWishes, interview: Interview, faults: Faults
) -> Table | None:
    """Rows of a file, a tidy one or a laboratory's own; what is wrong with it is added to `faults`.

    None where its columns cannot be used; raises BadInput for a file without cells, and for a cross table.
    """
    cells = read_cells(path, name, faults)
    if not cells.rows:
        raise BadInput(*faults or [f"{name}: is empty; the first row names the columns: observable, ..."])
    if is_tidy(cells.heading):
        columns = faults.of(tidy_columns, cells)
        return None if columns is None else table_of(cells, columns, faults)
    if not cells.lines:
        raise BadInput(*faults or [f"{name}: has a heading but no measurement, no measured value"])
    cells, assumed = upright(cells, interview), len(interview.assumed)
    columns = understood(cells, wishes, interview, faults)
    table = table_of(cells, columns, faults, scatter_is_error(cells, interview))
    if not any(column.role == "n" for column in columns):
        interview.assume("no column counts repeats: n is left empty, and a value counts as one measurement")
    return replace(table, notes=tuple(interview.assumed[assumed:]))
