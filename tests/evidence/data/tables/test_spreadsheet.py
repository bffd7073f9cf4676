"""Files of spreadsheets are read cell by cell, whatever code page, separator and decimal mark they have."""

import io
from pathlib import Path

import openpyxl
import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.tables.cell_numbers import CellFault, read_cell
from taichi_erosion.evidence.data.tables.column_roles import Told, column_roles
from taichi_erosion.evidence.data.tables.headings import read_heading
from taichi_erosion.evidence.data.tables.spreadsheet import read_cells
from taichi_erosion.evidence.data.tables.vocabulary import meaning_of

GERMAN = "Korngröße [µm];Wassergehalt in %;Böschungswinkel (°)\n250;1,6;33,5\n500;0,5;31,2\n"
RUSSIAN = (
    "Образец;Диаметр, мм;Влажность, %;Угол естественного откоса, град\nпесок;0,25;1,6;33,5\nпыль;0,5;0;31,2\n"
)
CHINESE = "样品\t粒径 (µm)\t含水率 (%)\t安息角 (°)\t备注\n沙\t250\t1.6\t33.5\t好\n土\t500\t0\t31.2\t好\n"
WANTED = ["grains.size.diameter", "conditions.moisture", "repose_angle"]


def cells_of(folder: Path, content: bytes, name: str = "t.csv"):
    (folder / name).write_bytes(content)
    return read_cells(folder / name, name, [])


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        *((GERMAN, code) for code in ("utf-8", "utf-8-sig", "utf-16", "cp1252")),
        (GERMAN.replace(";", "\t"), "cp1252"),
        (GERMAN.replace("1,6;33,5", '1,6;"33,5"'), "cp1252"),
        (GERMAN.replace(",", ".").replace(";", ","), "utf-8"),
        ("Messungen\n\n" + GERMAN.replace("\n", "\n;;\n"), "cp1252"),
        (RUSSIAN, "utf-8"),
        (RUSSIAN, "cp1251"),
        (CHINESE, "utf-8"),
        (CHINESE, "utf-16"),
    ],
)
def test_columns_are_known_in_any_code_page_and_language(tmp_path, text, encoding):
    cells = cells_of(tmp_path, text.encode(encoding))
    columns = column_roles(cells, Told(), [])
    assert [column.name for column in columns if column.name] == WANTED
    angle = next(column.place for column in columns if column.role == "observable")
    found = [read_cell(row[angle], cells.decimal_comma).value for _, row in cells.lines]
    assert found == ["33.5", "31.2"]


def test_a_percentage_of_a_workbook_is_what_it_shows(tmp_path):
    book, content = openpyxl.Workbook(), io.BytesIO()
    sheet = book.worksheets[0]
    sheet.append(("w [%]", "angle [deg]"))
    sheet.append((0.016, 33.5))
    sheet["A2"].number_format = "0.0%"
    book.save(content)
    cells = cells_of(tmp_path, content.getvalue(), "t.xlsx")
    assert [row for _, row in cells.lines] == [("1.6 %", "33.5")]


def test_a_sheet_of_words_before_the_table_is_no_table(tmp_path):
    book, content = openpyxl.Workbook(), io.BytesIO()
    for row in (("Campaign 2026",), ("Contact", "J. Smith", "phone 0123"), ("Method", "laser sensor")):
        book.worksheets[0].append(row)
    for title in ("April", "May"):
        sheet = book.create_sheet(title)
        for row in (("moisture [%]", "angle of repose [deg]"), (0, 31), (1, 33)):
            sheet.append(row)
    book.save(content)
    cells = cells_of(tmp_path, content.getvalue(), "t.xlsx")
    assert [row for _, row in cells.lines] == [("0", "31"), ("1", "33")]
    assert "sheet 'April' (not read: 'Sheet', 'May'; to use a table there, put its rows below" in cells.form


def test_rows_keep_their_number_in_the_file(tmp_path):
    cells = cells_of(tmp_path, b"title\n\na;b\n1;2\n\n3;4\n")
    assert [line for line, _ in cells.rows] == [3, 4, 6]


@pytest.mark.parametrize(
    ("cell", "comma", "value", "limit", "sd", "unit"),
    [
        ("31,2", True, "31.2", "", "", ""),
        ("31.2±0.8", False, "31.2", "", "0.8", ""),
        ("31,2 +/- 0,8 °", True, "31.2", "", "0.8", "°"),
        ("2 %", False, "2", "", "", "%"),
        ("< 0,02", True, "0.02", "<", "", ""),
        (">40", False, "40", ">", "", ""),
        ("1 250 µm", True, "1250", "", "", "µm"),
        ("\N{MINUS SIGN}5", False, "-5", "", "", ""),
        ("1,5e-3", True, "1.5e-3", "", "", ""),
        ("٣١", False, "31", "", "", ""),
        ("-", False, "", "", "", ""),
        ("k.A.", True, "", "", "", ""),
    ],
)
def test_a_number_is_read_as_laboratories_write_it(cell, comma, value, limit, sd, unit):
    found = read_cell(cell, comma)
    assert (found.value, found.limit, found.sd, found.unit) == (value, limit, sd, unit)


@pytest.mark.parametrize(
    ("cell", "comma", "low", "high", "unit"),
    [
        ("20..25 deg", False, "20", "25", "deg"),
        ("20,5 bis 25", True, "20.5", "25", ""),
        ("2 to 3", False, "2", "3", ""),
    ],
)
def test_an_interval_has_both_its_ends(cell, comma, low, high, unit):
    found = read_cell(cell, comma)
    assert (found.value, found.upper, found.unit) == (low, high, unit)


@pytest.mark.parametrize(
    "cell", ["25..20", "1.250,5", "1,2,3", "steil", "12. Mrz", "31.2 (0.8)", "30-32", "#N/A", "3 ± 10 %"]
)
def test_what_has_two_readings_or_is_no_number_is_refused(cell):
    with pytest.raises(CellFault):
        read_cell(cell, comma=True)


@pytest.mark.parametrize(
    ("heading", "name", "unit"),
    [
        ("flux [g/(m s)]", "flux", "g/(m s)"),
        ("Wassergehalt (Gew.-%)", "Wassergehalt", "%"),
        ("Schüttwinkel (Mittelwert) [°]", "Schüttwinkel (Mittelwert)", "°"),
        ("d / mm", "d", "mm"),
        ("Diameter, µm", "Diameter", "µm"),
        ("Winkel °", "Winkel", "°"),
        ("T (C)", "T", "degC"),
        ("Versuch (neu)", "Versuch", ""),
        ("u*t", "u*t", ""),
    ],
)
def test_a_heading_gives_name_and_unit(heading, name, unit):
    found = read_heading(heading)
    assert (found.name, found.unit) == (name, unit)


@pytest.mark.parametrize(
    ("heading", "meaning"),
    [
        ("relative Luftfeuchte", ("condition", "conditions.relative_humidity")),
        ("Threshold friction velocity", ("observable", "threshold_u_star")),
        ("friction velocity", ("condition", "conditions.friction_velocity")),
        ("Standardabweichung Winkel", ("sd", "")),
        ("Anzahl Wiederholungen", ("n", "")),
        ("Farbe", ("unknown", "")),
    ],
)
def test_the_longest_known_word_of_a_heading_counts(heading, meaning):
    assert meaning_of(heading) == meaning


def test_old_workbooks_are_refused_with_what_to_do(tmp_path):
    with pytest.raises(BadInput, match=r"save it as \.xlsx or \.csv"):
        cells_of(tmp_path, b"anything", "t.ods")


def test_formulas_that_were_never_computed_are_told_with_the_remedy(tmp_path):
    book = openpyxl.Workbook()
    for row in (("size [mm]", "angle [deg]"), (1.0, 30.0), (2.0, "=A3+30")):
        book.active.append(row)
    content = io.BytesIO()
    book.save(content)
    with pytest.raises(BadInput, match=r"cell B3: a formula that was never computed; open the workbook"):
        cells_of(tmp_path, content.getvalue(), "t.xlsx")
