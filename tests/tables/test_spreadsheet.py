"""Numbers of cells: powers of ten, ranges, marks of significance, and numbers of a law."""

from math import atan, degrees, nan

import pytest

from taichi_erosion.tables.cell_numbers import CellFault, read_cell
from taichi_erosion.tables.spreadsheet import Cells, apply_number_laws, with_one_heading

CELLS = """
0.57|0||5.7 x 10^-1|5.7\N{MULTIPLICATION SIGN}10⁻¹|5.7 E-01|5.7·10-1|5.7*10**-1
2000|0||2·10³
0.271|0||0·271
33.5|0|°|33° 30'
1.5e-3|0|kg/(m s)|1.5\N{MULTIPLICATION SIGN}10^-3 kg/(m s)
1200|0||1\u2009200
90|-inf||bis 90|up to 90
5|0|%|5 wt%
13.5|0.5||13-14|13\N{EN DASH}14|14 - 13|13.00-14.0
0.34|0.09|mm|0.43-0.25 mm|0.43 mm - 0.25 mm
2e-5|1e-5||1e-5-3e-5
40|inf||>40
1250|0|µm|1 250 µm
-5|0||\N{MINUS SIGN}5
1.5e-3|0||1,5e-3
31|0||٣١
22.75|2.25|deg|20,5 bis 25 deg
nan|0||k.A.
"""  # value, reach, unit, cells
WET = "moisture (% w.b.)"
UNCERTAIN = "2·103|~5|ca. 5|(5)|5?|10^|12-3-2020|25..20|1.250,5|1,2,3|steil|12. Mrz|31.2 (0.8)|#N/A|3 ± 10 %"


@pytest.mark.parametrize("line", CELLS.strip().splitlines())
def test_a_number_has_its_value_however_it_is_written(line):
    value, reach, unit, *cells = line.split("|")
    for cell in cells:
        found = read_cell(" ".join(cell.split()), comma="," in cell)
        numbers = found.value, found.reach, found.sd
        assert numbers == pytest.approx((float(value), float(reach), nan), nan_ok=True)
        assert found.unit == unit


def test_the_scatter_behind_a_number_is_read_with_it():
    found = read_cell("31,2 +/- 0,8 °", comma=True)
    assert (found.value, found.reach, found.sd, found.unit) == (31.2, 0.0, 0.8, "°")


@pytest.mark.parametrize("comma", [False, True])
@pytest.mark.parametrize("cell", UNCERTAIN.split("|"))
def test_what_has_two_readings_or_is_no_number_is_refused(cell, comma):
    with pytest.raises(CellFault):
        read_cell(cell, comma)


def test_an_interval_is_a_single_number_where_its_middle_is_asked_for():
    with pytest.raises(CellFault):
        read_cell("13-14", comma=False, single=True)
    assert read_cell("13-14", comma=False, single=True, middle=True).value == 13.5


@pytest.mark.parametrize(
    ("heading", "content", "wanted"),
    [
        ("repose angle (deg)", ["27.9 ± 0.4a†", "31.2 b*", "30"], [27.9, 31.2, 30.0]),
        ("flux (g/m/s)", ["0.40*", "0.50‡", "0.3"], [0.4, 0.5, 0.3]),
        ("d50 (phi)", ["2", "2-3", "x"], [0.25, 0.1875, nan]),
        ("mesh", ["40", "40/60", "42"], [0.425, 0.3375, 42.0]),
        ("sieve #", ["#40", "No. 60", "#40/60"], [0.425, 0.25, 0.3375]),
        ("tan(repose angle)", ["0.6", "1"], [degrees(atan(0.6)), 45.0]),
        (WET, ["20", "100"], [25.0, 100.0]),
        ("rest time (h)", ["1 h", "2 h"], [1.0, 2.0]),
    ],
)
def test_a_column_is_written_out(heading, content, wanted):
    column = apply_number_laws(Cells("f", tuple((k, (text,)) for k, text in enumerate([heading, *content]))))
    for (_, (text,)), value in zip(column.lines, wanted, strict=True):
        if value != value:
            with pytest.raises(CellFault):
                read_cell(text, comma=False)
        else:
            assert read_cell(text, comma=False).value == pytest.approx(value)


@pytest.mark.parametrize(
    ("heading", "cell", "unit", "sd"),
    [("mesh", "42", "mesh", nan), (WET, "100", "wet", nan), (WET, "20 ± 1", "", 1.5625)],
)
def test_scatter_follows_the_slope_of_a_law_and_a_unit_that_none_turns_is_told(heading, cell, unit, sd):
    (_, (text,)) = apply_number_laws(Cells("f", ((0, (heading,)), (1, (cell,))))).lines[0]
    found = read_cell(text, comma=False)
    assert (found.unit, found.sd) == (unit, pytest.approx(sd, nan_ok=True))


def test_a_line_above_the_headings_is_a_remark_or_a_part_of_them():
    for above, below, first in (
        ("J. Fluid Mech. 625;2500 kg/m3", "d (mm);u*t (m/s);SD", "d (mm)"),
        ("angle;;", "mean;SD;n", "angle mean"),  # merged, as a spreadsheet exports it
        ("sand;angle", ";mean;SD", "sand"),
        ("Factors;;Results", "d (mm);w (%);angle", "d (mm)"),
    ):
        rows = with_one_heading([(k, row.split(";")) for k, row in enumerate((above, below, "0.2;0.3;0.1"))])
        assert rows[0][1][0] == first


def test_letters_of_a_set_up_are_no_marks():
    cells = Cells("f", ((0, ("sample",)), (1, ("1a",)), (2, ("1b",))))
    assert apply_number_laws(cells).rows == cells.rows
