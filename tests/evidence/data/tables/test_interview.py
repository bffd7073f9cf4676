"""Meaning of tables as laboratories keep them: repeats side by side, relative scatter, instruments."""

import io
from pathlib import Path

import openpyxl
import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.study_files.new_study import Wishes, read_laboratory_table
from taichi_erosion.evidence.data.tables.interview import Interview, lies_on_its_side, upright
from taichi_erosion.evidence.data.tables.spreadsheet import Cells

LYING = (
    ("Probe", "A", "B", "C"),
    ("Korngröße [µm]", "90", "250", "500"),
    ("Feuchte in %", "0", "1", "2"),
    ("Böschungswinkel (°)", "31", "32", "33"),
)
Found = tuple[list[tuple[str, ...]], dict[str, str], list[str]]


def read(folder: Path, content: str | bytes, name: str = "heap.csv") -> Found:
    """Rows of the tidy table, roles of the columns by heading, what was assumed."""
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    interview = Interview(lambda _, guess: guess)
    tidy, _, columns = read_laboratory_table(folder / name, Wishes(closed_form=True), interview)
    return [row for _, row in tidy.lines], {c.heading.text: c.role for c in columns}, interview.assumed


def workbook(*rows: tuple, merged: tuple[str, ...] = ()) -> bytes:
    book, content = openpyxl.Workbook(), io.BytesIO()
    for row in rows:
        book.worksheets[0].append(row)
    for cells in merged:
        book.worksheets[0].merge_cells(cells)
    book.save(content)
    return content.getvalue()


def test_repeats_side_by_side_are_single_measurements(tmp_path):
    text = (
        "moisture [%];angle of repose 1 [deg];angle of repose 2 [deg];SD;n\n0;31;32.5;0.7;2\n1;33;34;0.8;2\n"
    )
    rows, roles, assumed = read(tmp_path, text)
    assert [(row[1], row[2], row[3]) for row in rows] == [(v, "", "") for v in ("31", "32.5", "33", "34")]
    assert roles["SD"] == roles["n"] == "remark"
    assert any("are repeats of one measurement" in words for words in assumed)
    assert "column 'SD' is not used: the repeats stand beside it" in assumed


def test_a_heading_of_merged_cells_stands_above_its_repeats(tmp_path):
    book = workbook(
        ("sample", "moisture", "angle of repose", None, None),
        (None, "%", "deg", "deg", "deg"),
        *(("A", 0, 31, 32, 30), ("B", 1, 33, 34, 35)),
        merged=("C1:E1",),
    )
    rows, _, _ = read(tmp_path, book, "heap.xlsx")
    assert [row[1] for row in rows] == ["31", "32", "30", "33", "34", "35"]
    assert {row[4] for row in rows} == {"deg"}


def test_two_rows_of_headings_under_merged_cells_are_one(tmp_path):
    book = workbook(
        ("sample", "moisture", "angle of repose", None, None, "run-out", None),
        (None, "%", "mean [deg]", "SD [deg]", "n", "mean [mm]", "SD [mm]"),
        *(("A", 0, 31, 0.7, 5, 120, 3), ("B", 1, 33, 0.8, 6, 110, 4)),
        merged=("C1:E1", "F1:G1"),
    )
    rows, _, _ = read(tmp_path, book, "heap.xlsx")
    assert [row[:5] for row in rows] == [
        ("repose_angle", "31", "0.7", "5", "deg"),
        ("runout_radius", "120", "3", "5", "mm"),
        ("repose_angle", "33", "0.8", "6", "deg"),
        ("runout_radius", "110", "4", "6", "mm"),
    ]


@pytest.mark.parametrize(
    ("heading", "cell", "sd"),
    [
        ("CV [%]", "2", 0.62),
        ("RSD in %", "4", 1.24),
        ("Variationskoeffizient", "3", 0.93),
        ("CV", "0.02", 0.62),
    ],
)
def test_relative_scatter_is_scatter_times_the_value(tmp_path, heading, cell, sd):
    rows, roles, _ = read(tmp_path, f"moisture [%];repose angle [deg];{heading}\n0;31;{cell}\n1;62;{cell}\n")
    assert roles[heading] == "cv"
    assert [float(row[2]) for row in rows] == pytest.approx([sd, 2.0 * sd])


def test_an_instrument_is_the_source_of_a_row(tmp_path):
    text = "moisture [%];repose angle [deg];Messgerät\n0;31;Kamera\n1;33;Laser\n"
    rows, roles, _ = read(tmp_path, text)
    assert roles["Messgerät"] == "source"
    assert [row[-1] for row in rows] == ["Kamera", "Laser"]


def test_scatter_of_a_quantity_that_is_not_used_is_not_that_of_another(tmp_path):
    text = "moisture [%];repose angle [deg];shininess [mm];SD;n\n0;31;5;0.2;5\n1;33;6;0.3;5\n"
    rows, roles, assumed = read(tmp_path, text)
    assert roles["SD"] == "remark"
    assert [row[2] for row in rows] == ["", ""]
    assert "column 'SD' is not used: it stands behind 'shininess [mm]', which is not used" in assumed


def test_headings_that_stand_again_begin_no_other_table(tmp_path):
    head = "d;moisture;angle of repose\nmm;%;deg\n"
    text = f"April;;\n{head}1;0;31\n1;1;33\n;;\nMay;;\n{head}1;0;30.5\n1;2;34\n"
    rows, _, _ = read(tmp_path, text)
    assert [row[1] for row in rows] == ["31", "33", "30.5", "34"]
    assert [row[-1] for row in rows] == [f"heap.csv, row {line}" for line in (4, 5, 10, 11)]


@pytest.mark.parametrize(("answer", "repeats"), [("y", 2), ("ja", 2), ("yes", 2), ("n", 0)])
def test_a_yes_to_repeats_is_understood_as_people_type_it(tmp_path, answer, repeats):
    (tmp_path / "heap.csv").write_text("moisture [%];W1 [deg];W2 [deg]\n0;31;32\n1;33;34\n", "utf-8")

    def told(question: str, guess: str) -> str:
        known = {"Column 'W": "repose_angle", "Columns 'W": answer}
        return next((said for words, said in known.items() if question.startswith(words)), guess)

    def rows() -> int:
        wishes, interview = Wishes(closed_form=True), Interview(told)
        return len(read_laboratory_table(tmp_path / "heap.csv", wishes, interview)[0].lines)

    if repeats:
        assert rows() == 2 * repeats
    else:
        with pytest.raises(BadInput, match="means repose_angle, as column"):
            rows()


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
