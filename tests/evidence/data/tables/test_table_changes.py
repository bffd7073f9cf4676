"""Corrected cells, added rows and rows that are gone are found, whatever the order of the rows."""

import random

from taichi_erosion.evidence.data.tables.rows import Table, table_of, tidy_columns
from taichi_erosion.evidence.data.tables.spreadsheet import Cells
from taichi_erosion.evidence.data.tables.table_changes import CellChange, table_changes

HEAD = ("observable", "value", "sd", "n", "unit", "group", "diameter [um]", "moisture [%]", "source")


def row(k: int, **cells: str) -> tuple[str, ...]:
    stated = {
        "observable": "repose_angle",
        "value": f"{30 + 0.37 * k:.2f}",
        "sd": "0.7",
        "n": "5",
        "unit": "deg",
        "group": "",
        "diameter": str(100 + 50 * (k // 3)),
        "moisture": str(k % 3),
        "source": f"t.csv, row {k + 2}",
    }
    return tuple((stated | cells).values())


def table(*rows: tuple[str, ...], head: tuple[str, ...] = HEAD) -> Table:
    cells = Cells("t.csv", tuple(enumerate((head, *rows), 1)))
    return table_of(cells, tidy_columns(cells), [])


BEFORE = table(*(row(k) for k in range(12)))


def test_the_same_rows_in_another_order_are_no_change():
    rows = [row(k) for k in range(12)]
    random.Random(2).shuffle(rows)
    numbered = ((*cells[:-1], f"t.csv, row {k}") for k, cells in enumerate(rows, 2))
    assert table_changes(BEFORE, table(*numbered)).none


def test_a_corrected_cell_is_told_with_row_column_and_both_values():
    rows = [row(k) for k in range(12)]
    rows[4] = row(4, diameter="1500")
    changes = table_changes(BEFORE, table(*rows))
    assert changes.cells == (CellChange(6, "diameter", "150", "1500"),)
    assert changes.earlier == tuple(range(12))
    assert not changes.added


def test_a_correction_an_addition_and_a_loss_at_once():
    rows = [row(k) for k in range(12) if k != 2]
    rows[5] = row(6, value="45.00")
    rows.append(row(20, value="50", diameter="999", moisture="7"))
    changes = table_changes(BEFORE, table(*rows))
    assert [(c.column, c.before, c.after) for c in changes.cells] == [("repose_angle", "32.22", "45")]
    assert (changes.removed, changes.added) == ((2,), (13,))


def test_another_unit_of_a_column_is_told_once():
    head = tuple("diameter [mm]" if cell == "diameter [um]" else cell for cell in HEAD)
    changes = table_changes(BEFORE, table(*(row(k) for k in range(12)), head=head))
    assert changes.units == (("diameter", "um", "mm"),)
    assert not changes.cells


def test_a_column_that_is_new_or_gone_is_told_cell_by_cell():
    head = (*HEAD, "slope [deg]")
    after = table(*((*row(k), "3") for k in range(12)), head=head)
    assert {(c.column, c.before, c.after) for c in table_changes(BEFORE, after).cells} == {("slope", "", "3")}
    assert {(c.column, c.before, c.after) for c in table_changes(after, BEFORE).cells} == {("slope", "3", "")}
