"""Differences of two versions of a tidy table: corrected cells, rows that were added, rows that are gone.

Rows of the two versions are paired first where they say the same, whatever their order, then so that the
fewest cells differ (an assignment problem). Two rows that differ in more than half of what varies among rows
are a pair only where they stand at the same place of tables of equal length.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from taichi_erosion.evidence.data.tables.spreadsheet import Cells

Cell = dict[str, str]  # cells of a row by name of the column, without its unit
PLACE = re.compile(r"(?P<file>.*), row (?P<line>\d+)")  # source of a row that names no other
IGNORED = ("vault",)
ALIKE = 0.5  # share of the cells that vary among rows in which two versions of a row agree
NEARER = 1e-3  # cells by which a pair one table length apart counts as worse than one in the same place


@dataclass(frozen=True)
class CellChange:
    """A cell that says something else."""

    line: int  # row in the new file
    column: str  # of a measured value its observable
    before: str
    after: str


@dataclass(frozen=True)
class TableChanges:
    """What a new version of a table says otherwise."""

    cells: tuple[CellChange, ...]
    units: tuple[tuple[str, str, str], ...]  # column, unit before, unit now
    added: tuple[int, ...]  # rows in the new file
    removed: tuple[int, ...]  # places among the rows of the earlier version, from 0
    earlier: tuple[int | None, ...]  # of every new row its place in the earlier version

    @property
    def none(self) -> bool:
        """Whether both versions say the same."""
        return not (self.cells or self.units or self.added or self.removed)


def source_names(sources: Sequence[str]) -> tuple[str, ...]:
    """Sources of rows: those that name no other are of one source, their file."""
    places = [PLACE.fullmatch(source) for source in sources]
    return tuple(place["file"] if place else source for place, source in zip(places, sources, strict=True))


def table_changes(before: Cells, after: Cells) -> TableChanges:
    """Changes from one tidy table to another."""
    old, new = plain_rows(before), plain_rows(after)
    earlier = paired(old, new)
    cells = [
        CellChange(line, row["observable"] if name == "value" else name, old[place].get(name, ""), text)
        for (line, _), row, place in zip(after.lines, new, earlier, strict=True)
        if place is not None
        for name, text in with_lost(row, old[place]).items()
        if not same(old[place].get(name, ""), text)
    ]
    was, now = units_of(before), units_of(after)
    units = [(name, was[name], unit) for name, unit in now.items() if was.get(name, unit) != unit]
    return TableChanges(
        tuple(cells),
        tuple(units),
        tuple(line for (line, _), place in zip(after.lines, earlier, strict=True) if place is None),
        tuple(place for place in range(len(old)) if place not in earlier),
        tuple(earlier),
    )


def plain_rows(cells: Cells) -> list[Cell]:
    """Cells of every row by name of the column; a source that only names the place in a file is left out."""
    names = [name_and_unit(cell)[0] for cell in cells.heading]
    rows = [dict(zip(names, row, strict=True)) for _, row in cells.lines]
    return [
        {
            name: text
            for name, text in row.items()
            if name not in IGNORED and not (name == "source" and PLACE.fullmatch(text))
        }
        for row in rows
    ]


def name_and_unit(heading: str) -> tuple[str, str]:
    """Name and unit of a heading of a tidy table."""
    name, _, unit = heading.partition("[")
    return name.strip(), unit.rstrip("] ")


def units_of(cells: Cells) -> dict[str, str]:
    """Units of the columns that state one."""
    return dict(map(name_and_unit, cells.heading))


def with_lost(row: Cell, earlier: Cell) -> Cell:
    """A row with empty cells for the columns that only its earlier version has."""
    return {**dict.fromkeys(earlier, ""), **row}


def same(before: str, after: str) -> bool:
    """Whether two cells say the same: equal text, or equal numbers."""
    try:
        return before == after or float(before) == float(after)
    except ValueError:
        return False


def paired(old: Sequence[Cell], new: Sequence[Cell]) -> list[int | None]:
    """Of every new row the place of its earlier version; None for a row that was added."""
    found: list[int | None] = [None] * len(new)
    free: dict[tuple[tuple[str, str], ...], list[int]] = {}
    for place, row in enumerate(old):
        free.setdefault(key_of(row), []).append(place)
    for place, row in enumerate(new):
        if there := free.get(key_of(row)):
            found[place] = there.pop(0)
    left = sorted(place for places in free.values() for place in places)
    open_rows = [place for place, earlier in enumerate(found) if earlier is None]
    if not left or not open_rows:
        return found
    telling = telling_columns([*old, *new])
    differing = np.zeros((len(left), len(open_rows)))
    for name in telling:
        was, now = (
            np.array([plain_number(rows[place].get(name, "")) for place in places])
            for rows, places in ((old, left), (new, open_rows))
        )
        differing += was[:, None] != now[None, :]
    apart = np.abs(np.subtract.outer(left, open_rows)) / max(len(old), len(new))
    for i, k in zip(*linear_sum_assignment(differing + NEARER * apart), strict=True):
        alike = differing[i, k] <= (1.0 - ALIKE) * len(telling)
        if alike or (len(old) == len(new) and left[i] == open_rows[k]):
            found[open_rows[k]] = left[i]
    return found


def key_of(row: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    """What a row says, in an order of its own."""
    return tuple(sorted((name, plain_number(text)) for name, text in row.items() if text))


def plain_number(text: str) -> str:
    """A number in one spelling; any other text as it stands."""
    try:
        return repr(float(text))
    except ValueError:
        return text


def telling_columns(rows: Sequence[Cell]) -> list[str]:
    """Columns that vary among rows."""
    names = dict.fromkeys(name for row in rows for name in row)
    return [name for name in names if len({plain_number(row.get(name, "")) for row in rows}) > 1]
