"""Differences of two versions of a table: corrected cells, rows that were added, rows that are gone.

Rows of the two versions are paired first where they say the same, whatever their order, then so that the
fewest cells differ (an assignment problem). Two rows that differ in more than half of what varies among rows
are a pair only where they stand at the same place of tables of equal length.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from taichi_erosion.evidence.data.tables.rows import PLACE, Table, tidy_fields

Fields = dict[str, str]  # cells of a row by name of the column, without its unit
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


def table_changes(before: Table, after: Table) -> TableChanges:
    """Changes from one version of a table to another."""
    old, new = plain_rows(before), plain_rows(after)
    earlier = paired(old, new)
    pairs = [(row.line, fields, place) for row, fields, place in zip(after.rows, new, earlier, strict=True)]
    cells = [
        CellChange(line, row["observable"] if name == "value" else name, old[place].get(name, ""), text)
        for line, row, place in pairs
        if place is not None
        for name, text in (dict.fromkeys(old[place], "") | row).items()
        if old[place].get(name, "") != text
    ]
    was, now = (dict(zip(each.conditions, each.units, strict=True)) for each in (before, after))
    units = [(n, was[n] or "", u or "") for n, u in now.items() if n in was and was[n] != u]
    return TableChanges(
        tuple(cells),
        tuple(units),
        tuple(line for line, _, place in pairs if place is None),
        tuple(place for place in range(len(old)) if place not in earlier),
        tuple(earlier),
    )


def plain_rows(table: Table) -> list[Fields]:
    """Cells of every row by name; a source that only names the place in a file is left out."""
    found = []
    for row in tidy_fields(table):
        plain = {name.partition("[")[0].strip(): text for name, text in row.items() if name != "vault"}
        found.append(plain | ({"source": ""} if PLACE.fullmatch(plain["source"]) else {}))
    return found


def paired(old: Sequence[Fields], new: Sequence[Fields]) -> list[int | None]:
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
    names = dict.fromkeys(name for row in (*old, *new) for name in row)
    telling = [name for name in names if len({row.get(name, "") for row in (*old, *new)}) > 1]
    was = np.array([[old[place].get(name, "") for name in telling] for place in left])
    now = np.array([[new[place].get(name, "") for name in telling] for place in open_rows])
    differing = np.sum(was[:, None] != now[None, :], axis=2)
    apart = np.abs(np.subtract.outer(left, open_rows)) / max(len(old), len(new))
    for i, k in zip(*linear_sum_assignment(differing + NEARER * apart), strict=True):
        alike = differing[i, k] <= (1.0 - ALIKE) * len(telling)
        if alike or (len(old) == len(new) and left[i] == open_rows[k]):
            found[open_rows[k]] = left[i]
    return found


def key_of(row: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    """What a row says, in an order of its own."""
    return tuple(sorted((name, text) for name, text in row.items() if text))
