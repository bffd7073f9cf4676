"""Tables whose headings stand in the first column, with one column for every sample: told and set upright."""

from dataclasses import replace

from taichi_erosion.evidence.data.tables.headings import read_heading
from taichi_erosion.evidence.data.tables.interview import Interview
from taichi_erosion.evidence.data.tables.spreadsheet import Cells
from taichi_erosion.evidence.data.tables.vocabulary import SCATTER, meaning_of

TELLING = ("observable", "condition", *SCATTER)
LEAST_KNOWN = 2  # headings that are known in the first column of such a table


def upright(cells: Cells, interview: Interview) -> Cells:
    """A table with its headings in the first row; one that lies on its side is set upright, if agreed.

    Rows of the table that is set upright count from the first column of the file. Raises BadInput.
    """
    if not lies_on_its_side(cells):
        return cells
    question = (
        f"{cells.file}: the headings seem to stand in the first column, with one column for every sample. "
        "Exchange rows and columns"
    )
    meaning = "rows and columns are exchanged: the headings stand in the first column"
    return exchanged(cells) if interview.agreed(question, meaning) else cells


def lies_on_its_side(cells: Cells) -> bool:
    """Whether the first column names a measured quantity and more, and the first row nothing known."""
    first = [row[0] for _, row in cells.rows]
    roles = {text: meaning_of(read_heading(text).name)[0] for text in (*first, *cells.heading[1:]) if text}
    down = [roles[text] for text in first if text]
    across = [roles[text] for text in cells.heading[1:] if text]
    known = [role for role in down if role in TELLING]
    return len(known) >= LEAST_KNOWN and "observable" in known and not any(role in TELLING for role in across)


def exchanged(cells: Cells) -> Cells:
    """A table with rows and columns exchanged."""
    columns = zip(*(row for _, row in cells.rows), strict=True)
    rows = tuple((k, column) for k, column in enumerate(columns, 1) if any(column))
    return replace(cells, file=f"{cells.file} (rows and columns exchanged)", rows=rows)
