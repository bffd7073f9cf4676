"""A tidy table is read cell by cell and told in its units; whatever is wrong is told in one line."""

from dataclasses import asdict
from math import inf, nan
from pathlib import Path

import pytest
from scene_tables import refusal

from taichi_erosion.evidence.data.measured import read_measured_table
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.scene.schema.units import Scale

ROOT = Path(__file__).parents[3]
HEAD = "observable,value,sd,n,unit,group,moisture [%],source\n"
WITH_SD = """observable,value,n,unit,group,moisture [%],sd of moisture [%]
repose_angle,33,3,deg,a,1.5,0.1
repose_angle,31,3,deg,b,0,
"""
OPERATORS = "observable,value,unit,operator\nangle,33,deg,KM\nangle,31,deg,EB\nangle,30,deg,{}\n"
GOOD = HEAD + "repose_angle,33.5,0.7,10,deg,heap,1.65,Hao\nrepose_angle,31.2,,,deg,heap,0,Hao\n"


def table(tmp_path: Path, text: str):
    (tmp_path / "heap.csv").write_text(text, encoding="utf-8")
    return read_measured_table(tmp_path / "heap.csv", "heap.csv")


def test_what_the_instrument_did_not_see_limits_and_intervals_are_censored(tmp_path):
    cells = {"< 2e-3": (2e-3, -inf), "": (nan, -inf), ">33.5": (33.5, inf), "2e1...25": (22.5, 2.5)}
    found = table(tmp_path, HEAD + "".join(f"flux,{cell},,,g/(m s),trap,2,me\n" for cell in cells)).rows
    assert all(row.censored for row in found)
    for row, wanted in zip(found, cells.values(), strict=True):
        assert (row.value, row.reach) == pytest.approx(wanted, nan_ok=True)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (HEAD, "heap.csv: no measured value; commas, semicolons or tabs"),
        (GOOD.replace("33.5", "nan"), "heap.csv: row 2, value = 'nan' must be a number (a measured one also"),
        (GOOD.replace("33.5", "1e999"), "heap.csv: row 2, value = '1e999' must be a finite number"),
        (GOOD.replace("0.7", "-0.7"), "heap.csv: row 2, sd = '-0.7' must be above 0; leave it empty"),
        (GOOD.replace("deg", "grad"), "heap.csv: row 2, unit = 'grad' is not known; degrees are written deg"),
        (GOOD.replace("deg", "angle"), "heap.csv: row 2, unit = 'angle' is not known; allowed: 1, %, deg"),
        (GOOD.replace("[%]", "[wet]"), "heap.csv: heading 'moisture [wet]': unknown unit; allowed: 1"),
        (GOOD.replace("value", "valeu"), "heap.csv: column 'valeu' is unknown; did you mean 'value'?"),
        (GOOD.replace("unit,", "kind,"), "heap.csv: column 'unit' is missing"),
        (OPERATORS.format("KM"), "heading 'operator': its words recur: call it 'group' if they name set-ups"),
        (GOOD.replace("group", "value"), "heap.csv: column 'value' stands in the heading twice"),
        (GOOD.replace("repose_angle,33", "slip angle,33"), "observable = 'slip angle' must be a name"),
        (WITH_SD.replace("of moisture", "of moistur"), "no column 'moistur'; conditions there: moisture"),
        (WITH_SD.replace("moisture [%]\n", "moisture [mm]\n"), "is in [mm]; moisture is in [%]: give"),
        (WITH_SD.replace(",0.1", ",-0.1"), "row 2, sd of moisture [%] = '-0.1' must be above 0"),
    ],
)
def test_what_is_wrong_is_told_with_row_column_and_value(tmp_path, text, told):
    line = refusal(table, tmp_path, text)
    assert line.startswith("heap.csv")
    assert told in line


def test_a_column_of_words_that_do_not_recur_is_not_used(tmp_path):
    found = table(tmp_path, OPERATORS.format("MK"))
    assert (found.conditions, found.notes) == ((), ("not used: 'operator'",))


@pytest.mark.parametrize("table_file", sorted((ROOT / "doe/measured").glob("*.csv")), ids=lambda f: f.stem)
def test_every_shipped_table_can_be_read_and_names_its_sources(table_file):
    assert all(row.source for row in read_measured_table(table_file).rows)


def test_values_and_conditions_are_told_in_the_units_of_the_table_also_from_a_stored_document():
    at = {"diameter": Scale("um", 1e-6), "temperature": Scale("°C", 1.0, 273.15), "roughness": Scale("1")}
    units = TableUnits({"threshold": Scale("cm/s", 0.01)}, at)
    assert units.value_text("threshold", 0.253) == "25.3 cm/s"
    assert units.value("threshold", 0.02) == pytest.approx(2.0)
    told = units.conditions_text({"diameter": 2.3e-4, "temperature": 303.15, "roughness": 0.1, "slope": nan})
    assert told == "diameter = 230 um, temperature = 30 °C, roughness = 0.1"
    assert TableUnits.of({"table_units": asdict(units)}) == units
    assert TableUnits.of({"units": {"threshold": "m/s"}}).value_text("threshold", 0.253) == "0.253 m/s"
