"""A table that lies on its side is known as such, and set upright."""

import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.tables.interview import Interview
from taichi_erosion.evidence.data.tables.orientation import lies_on_its_side, upright
from taichi_erosion.evidence.data.tables.spreadsheet import Cells

LYING = (
    ("Probe", "A", "B", "C"),
    ("Korngröße [µm]", "90", "250", "500"),
    ("Feuchte in %", "0", "1", "2"),
    ("Böschungswinkel (°)", "31", "32", "33"),
)


def cells(*rows: tuple[str, ...]) -> Cells:
    return Cells("heap.csv", tuple(enumerate(rows, 1)))


def test_a_lying_table_is_known_and_an_upright_one_is_not():
    assert lies_on_its_side(cells(*LYING))
    assert not lies_on_its_side(cells(*zip(*LYING, strict=True)))
    assert lies_on_its_side(cells(*LYING[1:])), "without a row of samples"
    words = (("Probe", "Böschungswinkel (°)"), ("Wasser", "31"), ("Talus", "32"))
    assert not lies_on_its_side(cells(*words)), "samples that are called by known words"


def test_a_lying_table_is_set_upright_where_that_is_agreed():
    interview = Interview(lambda _, guess: guess)
    found = upright(cells(*LYING), interview)
    assert [row for _, row in found.rows] == [tuple(column) for column in zip(*LYING, strict=True)]
    assert [line for line, _ in found.rows] == [1, 2, 3, 4], "rows count as columns of the file"
    assert interview.assumed == ["rows and columns are exchanged: the headings stand in the first column"]
    assert found.file == "heap.csv (rows and columns exchanged)"


def test_a_lying_table_stays_where_that_is_not_agreed():
    assert upright(cells(*LYING), Interview(lambda *_: "no")).rows == cells(*LYING).rows
    with pytest.raises(BadInput, match="'perhaps' is not yes or no"):
        upright(cells(*LYING), Interview(lambda *_: "perhaps"))
