"""Foreign tables and the rows that they come to: code pages, units, scatter, repeats, workbooks."""

import io
from math import inf, nan
from pathlib import Path

import openpyxl
import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.new_study import NewStudyOptions, read_laboratory_table, table_options
from taichi_erosion.evidence.data.tables.column_roles import Interview
from taichi_erosion.evidence.data.tables.rows import Table

GERMAN = "Korngröße [µm];Wassergehalt in %;Böschungswinkel (°)\n250;1,6;33,5\n500;0,5;31,2\n"
RUSSIAN = "Образец;Диаметр, мкм;Влажность, %;Угол естественного откоса, град\n"
RUSSIAN += "песок;250;1,6;33,5\nпыль;500;0,5;31,2\n"
CHINESE = "样品\t粒径 (µm)\t含水率 (%)\t安息角 (°)\t备注\n沙\t250\t1.6\t33.5\t好\n土\t500\t0.5\t31.2\t好\n"
LYING = "Probe;A;B;C\nKorngröße [µm];90;250;500\nFeuchte in %;0;1;2\nBöschungswinkel (°);31;32;33\n"
SAMPLES = (("A", 0, 31, 32), ("B", 1, 33, 34))
INSIDE = "\n0,5;31,0;34,2;36,1\n1,0;30,5;32,0;33,1\n2,0;30,1;30,8;31,5\n"


def workbook(*sheets: tuple[tuple, ...], merged: tuple[str, ...] = (), shares: tuple[str, ...] = ()) -> bytes:
    book, content = openpyxl.Workbook(), io.BytesIO()
    for place, rows in enumerate(sheets):
        sheet = book.create_sheet() if place else book.worksheets[0]
        for row in rows:
            sheet.append(row)
    for cells in merged:
        book.worksheets[0].merge_cells(cells)
    for cell in shares:
        book.worksheets[0][cell].number_format = "0.0%"
    book.save(content)
    return content.getvalue()


def read(folder: Path, content: str | bytes, name: str = "heap.csv", ask=lambda _, guess: guess) -> Table:
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return read_laboratory_table(folder / name, table_options(NewStudyOptions()), Interview(ask))


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        *((GERMAN, code) for code in ("utf-8", "utf-8-sig", "utf-16", "cp1252")),
        (GERMAN.replace(";", "\t"), "cp1252"),
        (GERMAN.replace("1,6;33,5", '1,6;"33,5"'), "cp1252"),
        (GERMAN.replace(",", ".").replace(";", ","), "utf-8"),
        ("Messungen\n\n" + GERMAN.replace("\n", "\n;;\n"), "cp1252"),
        ("sep=;\n" + GERMAN, "cp1252"),
        (RUSSIAN, "utf-8"),
        (RUSSIAN, "cp1251"),
        (CHINESE, "utf-8"),
        ("Korngröße;Wassergehalt;Böschungswinkel\n;;\nµm;%;°\n250;1,6;33,5\n500;0,5;31,2\n", "cp1252"),
        ("Durchmesser;Feuchte;Böschungswinkel\n250 µm;1,6 %;33,5 °\n500 µm;0,5 %;31,2 °\n", "cp1252"),
    ],
)
def test_one_table_has_the_same_rows_however_it_is_written(tmp_path, text, encoding):
    found = read(tmp_path, text.encode(encoding))
    assert found.conditions == ("diameter", "moisture")
    assert {row.observable for row in found.rows} == {"repose_angle"}
    assert {row.conditions: row.value for row in found.rows} == {(250.0, 1.6): 33.5, (500.0, 0.5): 31.2}
    assert [row.value for row in found.rows] == [33.5, 31.2]


def angle(value: float, sd: float = nan, n: int | None = None, unit: str = "deg") -> tuple:
    return "repose_angle", float(value), sd, n, unit


def angles(*values: float, unit: str = "°") -> list[tuple]:
    return [angle(value, unit=unit) for value in values]


MERGED = workbook(
    (
        ("sample", "moisture", "angle of repose", None, None, "run-out", None),
        (None, "%", "mean [deg]", "s [deg]", "n", "mean [mm]", "SD [mm]"),
        *(("A", 0, 31, 0.7, 5, 120, 3), ("B", 1, 33, 0.8, 6, 110, 4)),
    ),
    merged=("C1:E1", "F1:G1"),
)
ABOVE = (("sample", "moisture", "angle of repose", None), (None, "%", "deg", None), *SAMPLES)
RUNOUT = [("runout_radius", 120.0, 3.0, 5, "mm"), ("runout_radius", 110.0, 4.0, 6, "mm")]
TWO = "moisture [%];angle of repose 1 [deg];angle of repose 2 [deg];SD;n\n0;31;32.5;0.7;2\n1;33;34;0.8;2\n"
ERRORS = "moisture (g/g);angle of repose (deg);standard error;repeats\n0.00;31.2;0.3;9\n0.02;34;0.4;4\n"
UNUSED = "moisture [%];repose angle [deg];shininess [mm];SD;tau;sigma_tau;n\n0;31;5;0.2;1;0.1;5\n"
LOST = "moisture [%];repose angle [deg];sd;n;note\n0;31;0.5;5;\n1;n/a;;;lost\n2;-;;;\n"
SIEVES = "Korngröße [mm];Böschungswinkel (°);fraction 0.1 mm [%];fraction 0.2 mm [%]" + INSIDE
# content -> (observable, value, sd, n, unit) of every row
FOREIGN = {
    "two rows of headings": (MERGED, [angle(31, 0.7, 5), RUNOUT[0], angle(33, 0.8, 6), RUNOUT[1]]),
    "a heading above repeats": (workbook(ABOVE, merged=("C1:D1",)), angles(31, 32, 33, 34, unit="deg")),
    "one row like numbers of repeats": ("w [%];Böschungswinkel [°]\n1;2\n1;20\n2;21\n", angles(2, 20, 21)),
    "repeats side by side": (TWO, angles(31, 32.5, 33, 34, unit="deg")),
    "scatter behind the sign": (
        "d [mm];Schüttwinkel [°];n\n1;31,2 ± 0,8;5\n2;30,1 (+/- 0,7);5\n",
        [angle(31.2, 0.8, 5, "°"), angle(30.1, 0.7, 5, "°")],
    ),
    "standard errors": (ERRORS, [angle(31.2, 0.9, 9), angle(34, 0.8, 4)]),
    "scatter of quantities that are not used": (UNUSED, [angle(31, nan, 5)]),
    "sd in mm": ("w [%];pile height [cm];SD [mm]\n0;4;1\n", [("pile_height", 4.0, 0.1, None, "cm")]),
    "diameter": ("w [%];Haufendurchmesser [mm];SD\n0;40;1\n", [("runout_radius", 20.0, 0.5, None, "mm")]),
    "a table on its side": (LYING, angles(31, 32, 33)),
    "cells without a measurement": (LOST, [angle(31, 0.5, 5)]),
    "sieve fractions": (SIEVES, angles(31, 30.5, 30.1)),
}
for below in (";°;°", ";1;2", ";;"):
    text = f"w [%];Böschungswinkel [°];\n{below}\n0;31;32\n1;33;34\n"
    FOREIGN[f"a merged heading, below it {below}"] = text, angles(31, 32, 33, 34)
for heading in ("CV [%]", "SD (%)", "RSD in %", "Variationskoeffizient", "CV"):
    text = f"moisture [%];repose angle [deg];{heading}\n0;50;{0.02 if heading == 'CV' else 2}\n"
    FOREIGN[f"relative scatter, {heading}"] = text, [angle(50, 1.0)]


@pytest.mark.parametrize("name", FOREIGN)
def test_a_foreign_table_comes_to_these_rows(tmp_path, name):
    content, wanted = FOREIGN[name]
    found = read(tmp_path, content, "heap.csv" if isinstance(content, str) else "heap.xlsx")
    rows = [(row.observable, row.value, row.sd, row.n, row.unit) for row in found.rows]
    for row, expected in zip(rows, wanted, strict=True):
        assert row == pytest.approx(expected, nan_ok=True)


def test_a_value_that_is_possible_and_unusual_is_told(tmp_path):
    interview = Interview(lambda asked, guess: guess)
    (tmp_path / "heap.csv").write_text("w [%];Böschungswinkel [°]\n1;31\n150;32\n2;33\n", encoding="utf-8")
    read_laboratory_table(tmp_path / "heap.csv", table_options(NewStudyOptions()), interview)
    assert [words for words in interview.assumptions if "unusual" in words] == [
        "row 3, moisture = 150 % is unusual: used as it is"
    ]


def test_values_of_which_most_are_unusual_are_asked(tmp_path):
    text = "Humidity [%];Böschungswinkel [°]\n0,3;31\n0,8;32\n2;33\n50;33\n"
    with pytest.raises(BadInput, match=r"which is unusual.* --unit 'Humidity \[%\]=%'"):
        read(tmp_path, text)


def test_limits_and_intervals_are_censored_values(tmp_path):
    text = "Feuchte (%);Sandfluss [g/(m s)]\n0;12,5\n1;< 0,02\n2;no transport\n3;0,1..0,4\n4;>40\n"
    found = [each for row in read(tmp_path, text).rows for each in (row.value, row.reach, row.censored)]
    wanted = [12.5, 0, False, 0.02, -inf, True, 0.02, -inf, True, 0.25, 0.15, True, 40, inf, True]
    assert found == pytest.approx(wanted, nan_ok=True)


def test_rows_keep_their_number_in_the_file_and_their_source(tmp_path):
    found = read(tmp_path, "title\n\nmoisture [%];repose angle [deg];Messgerät\n1;30;Laser\n\n3;31;\n")
    assert [row.line for row in found.rows] == [4, 6]
    assert [row.source for row in found.rows] == ["Laser", "heap.csv, row 6"]


def test_a_percentage_of_a_workbook_is_what_it_shows(tmp_path):
    book = workbook((("w [%]", "angle of repose [deg]"), (0.016, 33.5)), shares=("A2",))
    assert read(tmp_path, book, "t.xlsx").rows[0].conditions == (1.6,)


def test_the_first_sheet_with_a_table_is_read_and_the_others_are_told(tmp_path):
    words = (("Campaign 2026",), ("Contact", "J. Smith", "phone 0123"), ("Method", "laser sensor"))
    april, may = ((("moisture [%]", head), (0, 31), (1, 33)) for head in ("repose angle [deg]", "clay [%]"))
    found = read(tmp_path, workbook(words, april, may), "t.xlsx")
    assert [row.value for row in found.rows] == [31.0, 33.0]
    assert "not read: 'Sheet', 'Sheet2'" in found.form
    with pytest.raises(BadInput, match="sheets 'Sheet1', 'Sheet2' have the same headings"):
        read(tmp_path, workbook(words, april, april), "t.xlsx")


def test_the_sd_of_a_condition_is_its_error(tmp_path):
    found = read(tmp_path, "moisture [%];sd of moisture [%];repose angle [deg]\n0;;31\n1;0,1;33\n")
    assert found.conditions == ("moisture",)
    assert [row.condition_sd for row in found.rows] == [{}, {"moisture": 0.1}]


def test_columns_are_what_the_user_answers(tmp_path):
    text = "moisture [%];W1 [deg];W2 [deg]\n0;31;32\n1;33;34\n"

    def told(answer: str):
        known = {"Column 'W": "repose_angle", "Columns 'W": answer}
        return lambda asked, guess: next((known[words] for words in known if asked.startswith(words)), guess)

    assert [len(read(tmp_path, text, ask=told(answer)).rows) for answer in ("y", "ja")] == [4, 4]
    with pytest.raises(BadInput, match="means repose_angle, as column"):
        read(tmp_path, text, ask=told("n"))
    with pytest.raises(BadInput, match="no scene measures 'Quark'; known: repose_angle"):
        read(tmp_path, text, ask=lambda words, _: "Quark" * words.startswith("Column 'W1"))


@pytest.mark.parametrize(
    "heading",
    [
        "Korngröße [mm];0;1;2",
        ";0 %;1 %;2 %",
        "Korngröße [mm];w=0 %;w=1 %;w=2 %",
        "Korngröße [mm];Böschungswinkel 0 % [°];Böschungswinkel 1 % [°];Böschungswinkel 2 % [°]",
        "moisture [%];repose angle (0.5 mm);repose angle (1 mm);repose angle (2 mm)",
    ],
)
def test_a_cross_table_is_not_read_as_repeats(tmp_path, heading):
    with pytest.raises(BadInput) as caught:
        read(tmp_path, heading + INSIDE)
    assert any("of a cross table write one row for every" in fault for fault in caught.value.faults)
