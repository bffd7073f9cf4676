"""Cross tables are refused; repeats side by side, sieve fractions and winds at heights are none."""

import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.tables.column_roles import Told, column_roles
from taichi_erosion.evidence.data.tables.cross_table import cross_table_faults
from taichi_erosion.evidence.data.tables.interview import Interview, TableWishes, understood
from taichi_erosion.evidence.data.tables.spreadsheet import Cells

INSIDE = (("0,5", "31,0", "34,2", "36,1"), ("1,0", "30,5", "32,0", "33,1"), ("2,0", "30,1", "30,8", "31,5"))


def cells(heading: str, *rows: tuple[str, ...]) -> Cells:
    lines = (tuple(heading.split(";")), *(rows or INSIDE))
    return Cells("heap.csv", tuple(enumerate(lines, 1)), True)


def faults(table: Cells, told: Told | None = None) -> list[str]:
    return list(cross_table_faults(table, column_roles(table, told or Told(), [])))


@pytest.mark.parametrize(
    "heading",
    [
        "Korngröße [mm];0;1;2",
        "Korngröße [mm] \\ Wassergehalt [%];0;1;2",
        ";0 %;1 %;2 %",
        "Korngröße [mm];w=0 %;w=1 %;w=2 %",
        "Korngröße [mm];Böschungswinkel 0 % [°];Böschungswinkel 1 % [°];Böschungswinkel 2 % [°]",
        "Korngröße [mm];Böschungswinkel bei w = 0,5 %;Böschungswinkel bei w = 1 %",
        "moisture [%];repose angle (0.5 mm);repose angle (1 mm);repose angle (2 mm)",
    ],
)
def test_a_condition_across_the_headings_is_known(heading):
    (told,) = faults(cells(heading))
    assert (
        "seem to hold values of a condition (a cross table): write one row for every measured value" in told
    )
    assert f"'{heading.split(';')[1]}'" in told


def test_a_condition_in_the_row_below_merged_headings_is_known():
    heading = "moisture [%];repose angle 1;repose angle 2;repose angle 3"
    (told,) = faults(cells(heading, ("", "0,5", "1", "2"), *INSIDE))
    assert told.startswith("heap.csv: row 2 has numbers without any condition")


@pytest.mark.parametrize(
    "heading",
    [
        "Korngröße [mm];Böschungswinkel 1 [°];Böschungswinkel 2 [°];Böschungswinkel 3 [°]",
        "Korngröße [mm];Böschungswinkel 1 °;Böschungswinkel 2 °;Böschungswinkel 3 °",
        "Korngröße [mm];Böschungswinkel (°);fraction 0.1 mm [%];fraction 0.2 mm [%]",
        "Korngröße [mm];Böschungswinkel (°);sd;n",
        "Korngröße [mm];u*t [m/s];wind speed at 1 m [m/s];wind speed at 2 m [m/s]",
        "Korngröße [mm];threshold wind speed 1 m;threshold wind speed 2 m;threshold wind speed 4 m",
    ],
)
def test_repeats_fractions_and_winds_are_no_cross_table(heading):
    assert faults(cells(heading)) == []


def test_a_table_is_not_read_as_repeats_of_one_measurement():
    crossed = cells("Korngröße [mm];Böschungswinkel 0 %;Böschungswinkel 1 %;Böschungswinkel 2 %")
    with pytest.raises(BadInput, match="a cross table"):
        understood(crossed, TableWishes(measures=("repose_angle",)), Interview(lambda _, guess: guess), [])
