"""What a table does not say is asked, stated by an option or refused; what no model reads is a condition."""

import io
import re
from collections.abc import Mapping
from math import log
from pathlib import Path

import numpy as np
import openpyxl
import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.comparison_rows import comparison_rows
from taichi_erosion.evidence.data.problem import Measurements
from taichi_erosion.evidence.data.tables.column_roles import TableOptions
from taichi_erosion.evidence.models import reduced
from taichi_erosion.evidence.models.load_study import load_study
from taichi_erosion.evidence.models.prepared_problem import condition_errors
from tests.evidence.asking import Rows, closed_form_study

SANDS = [(0.25, 0, 0.233), (0.25, 0.6, 0.299), (0.5, 0, 0.319)]
SANDS += [(0.5, 0.6, 0.445), (1, 0, 0.472), (1, 0.6, 0.606)]
HEAD = "d [mm],moisture [%],u*t [m/s],SD [m/s]\n"
BLANK = HEAD + "".join(f"{'' if w else d},{w},{u},0.01\n" for d, w, u in SANDS)
HEAP = "moisture (%);angle of repose (deg);SD;{}\n"
SALT = "moisture (%);{};angle of repose (deg);SD\n"


def measured(folder: Path, rows: Rows, name: str = "t.csv", **wishes) -> tuple[Measurements, list[str]]:
    """Measurements of the study of a table by the closed form, and what was assumed."""
    study, assumed = closed_form_study(folder, rows, name, **wishes)
    return study.problem.measurements, assumed


def refused(folder: Path, rows: Rows, **wishes) -> str:
    with pytest.raises(BadInput) as caught:
        measured(folder, rows, **wishes)
    assert not (folder / "t").exists(), "nothing is written"
    return "\n".join(caught.value.faults)


def test_a_blank_cell_of_a_condition_is_refused_or_filled_where_the_user_says_so(tmp_path):
    assert "'d [mm]' is blank in 3 rows (3, 5, 7)" in refused(tmp_path, BLANK)
    found, assumed = measured(tmp_path, BLANK, fill_down=True)
    assert found.conditions["diameter"] == pytest.approx([1e-3 * d for d, *_ in SANDS])
    assert any("3 blank cells are filled" in words for words in assumed)
    left, _ = measured(tmp_path, BLANK.replace("\n,", "\n-,"))
    assert left.line == (2, 4, 6), "a row of which a condition is not known is not used"


def test_a_condition_that_no_model_reads_is_filled_down_too(tmp_path):
    heaps = [(0, 1, 31), (1, "", 32), (2, "", 35), (0, 4, 33), (1, "", 36), (2, "", 34)]
    text = SALT.format("salt (%)") + "".join(f"{w};{salt};{angle};0.5\n" for w, salt, angle in heaps)
    found, assumed = measured(tmp_path, text, fill_down=True)
    assert found.conditions["salinity"].tolist() == pytest.approx([0.01] * 3 + [0.04] * 3)
    assert any("'salt (%)': 4 blank cells are filled" in words for words in assumed)


def test_a_blank_set_up_is_refused_and_cells_that_are_merged_are_filled(tmp_path):
    text = "Soil;" + HEAP.format("n") + "A;0;31;0.5;3\n;2;33;0.5;3\nB;0;34;0.5;3\n;2;36;0.5;3\n"
    assert "'Soil' is blank in 2 rows (3, 5)" in refused(tmp_path, text)
    book, content = openpyxl.Workbook(), io.BytesIO()
    for line in text.splitlines():
        cells = line.split(";")
        book.worksheets[0].append([float(c) if c[:1].isdigit() else c or None for c in cells])
    for cells in ("A2:A3", "A4:A5"):
        book.worksheets[0].merge_cells(cells)
    book.save(content)
    assert measured(tmp_path, content.getvalue(), "t.xlsx")[0].group == ("A", "A", "B", "B")


@pytest.mark.parametrize(("name", "reads"), [("threshold_u_star", True), ("repose_angle", False)])
def test_the_closed_form_has_no_value_where_a_condition_that_it_reads_is_not_stated(name, reads):
    at = {"diameter": np.array([2.5e-4, np.nan]), "moisture": np.zeros(2)}
    assert np.isnan(reduced.model_mean(name, at, {}, {})).tolist() == [False, reads]


def test_what_no_column_states_of_the_grains_is_a_constant_condition(tmp_path):
    text = "moisture [%],u*t [m/s],SD [m/s]\n0,0.57,0.01\n0.5,0.74,0.01\n1.5,0.85,0.01\n"
    found, assumed = measured(tmp_path, text, diameter="1.5 mm", density="2.7 g/cm3")
    assert found.conditions["diameter"] == pytest.approx(1.5e-3)
    assert found.conditions["density"] == pytest.approx(2700.0)
    assert not any("diameter" in words for words in assumed)
    usual, assumed = measured(tmp_path, text)
    assert usual.conditions["diameter"] == pytest.approx(2.5e-4)
    assert "no column states the grain diameter: 0.25 mm is assumed (--diameter)" in assumed


def test_the_scatter_that_the_user_states_is_that_of_single_measurements(tmp_path):
    text = "moisture [%];angle of repose [deg];n\n0;31;3\n2;40;3\n4;35;3\n"
    assert "the scatter is unknown" in refused(tmp_path, text)
    for key, said, wanted in (
        ("angle of repose", "0.8 deg", [0.8] * 3),
        ("repose_angle", "0.01 rad", [np.degrees(0.01)] * 3),
        ("angle of repose [deg]", "10 %", [3.1, 4.0, 3.5]),
    ):
        assert measured(tmp_path, text, sd={key: said})[0].sd == pytest.approx(wanted)
    with pytest.raises(BadInput, match="a column of the table states it"):
        measured(tmp_path, text.replace("n\n", "SD\n"), sd={"repose_angle": "5 %"})
    with pytest.raises(BadInput, match="--sd flux=5 %: names no column"):
        measured(tmp_path, text, sd={"flux": "5 %"})


def test_a_number_behind_the_sign_of_a_condition_is_its_sd(tmp_path):
    text = "moisture (%);angle of repose (°)\n1 ± 0.5;40 ± 1\n4;37 ± 1\n8 ± 2;36 ± 1\n"
    found, assumed = measured(tmp_path, text)
    assert found.condition_sd["moisture"] == pytest.approx([0.005, np.nan, 0.02], nan_ok=True)
    assert found.sd == pytest.approx(1.0)
    assert any("± in 'moisture (%)' is the standard deviation of the stated" in words for words in assumed)


@pytest.mark.parametrize(
    ("heading", "names"),
    [
        ("angle 1;angle 2;Mean;SD", {"angle": "repose_angle"}),
        ("A1;A2;Mean angle of repose;SD", {"A1": "repose_angle"}),
        ("angle of repose rep 1;angle of repose rep 2;mean angle of repose;SD", {}),
        ("angle of repose;;average;SD\n;rep 1;rep 2;;", {}),
        ("angle of repose I;angle of repose II;Mean;SD", {}),
    ],
)
def test_numbered_siblings_are_repeats_and_their_mean_is_no_other_one(tmp_path, heading, names):
    rows = "".join(f"{w};{a};{a + 1};{a + 0.5};0.7\n" for w, a in ((0, 31), (1, 35), (2, 38), (4, 36)))
    found, _ = measured(tmp_path, f"moisture (%);{heading}\n{rows}", table_options=TableOptions(names))
    assert found.value.tolist() == [31, 32, 35, 36, 38, 39, 36, 37]
    assert list(found.conditions) == ["moisture"]
    assert np.isnan(found.sd).all()


@pytest.mark.parametrize(
    ("cells", "limit"),
    [
        (("0", "0"), 0.85),  # the least that was seen
        (("no transport", "<0.05"), 0.05),
        (("0", "<0.05"), 0.05),
        (("<0.05", "<0.2"), 0.05),
    ],
)
def test_an_amount_that_is_not_seen_lies_below_a_limit_and_needs_no_further_file(tmp_path, cells, limit):
    text = "u* (m/s);moisture (%);flux (g/m/s);sd\n0.4;0;9.16;0.5\n0.5;0;12.6;1\n0.4;1;0.85;0.1\n"
    text += f"0.3;1;{cells[0]};\n0.3;2;{cells[1]};\n"
    found, _ = measured(tmp_path, text)
    assert found.censored.tolist() == [False] * 3 + [True] * 2
    assert found.limit[3] == pytest.approx(1e-3 * limit)
    flux = load_study(tmp_path / "t" / "t.toml").problem.observables["flux"]
    assert (flux.transform, flux.floor) == ("log_floor", pytest.approx(max(1e-3 * limit, 8.5e-5)))
    ranges = "u* (m/s);flux (g/m/s)\n0.3;0.1-2\n0.4;1-2.4\n"
    assert measured(tmp_path, ranges, "r.csv", sd={"flux": "8 %"})[0].size == 2


@pytest.mark.parametrize(
    ("heading", "values", "kept"),
    [
        ("salt content (g/kg)", (0, 0, 0, 0, 5, 5, 5, 5), True),
        ("Luftfeuchte (%)", (20, 20, 40, 40, 40, 40, 20, 20), True),
        ("drop height", (1, 2, 2, 1, 2, 1, 1, 2), True),
        ("salt content (g/kg)", (3,) * 8, False),  # constant
        ("Reihenfolge", range(4, 12), False),
        ("freezing cycles", (0, 2, 6, 4, 1, 3, 7, 5), True),  # the result follows it
        ("year", (2020, 2021, 2020, 2021, 2020, 2021, 2020, 2021), False),
        ("predicted (deg)", (30, 33, 36, 35, 31, 32, 37, 34), False),
        ("tangent of it", (0.601, 0.7, 0.781, 0.727, 0.613, 0.713, 0.795, 0.74), False),
        ("class", (1, 2, 3, 4, 1, 2, 3, 4), False),  # the moisture again
        ("Temperatur (°C)", (20.1, 20.4, 19.8, 21.1, 20.2, 19.9, 20.6, 21.2), False),
        ("room (°C)", (20.1, 20.4, 19.8, 21.1, 20.2, 19.9, 20.6, 21.2), False),  # tells repeats apart
        ("humidity (%)", (36, 51, 64, 82, 49, 66, 79, 36), False),  # repeats do not follow it
        ("salt content (g/kg)", (0, 5, "", 5, 0, 5, 0, 5), False),
        ("crust (kPa)", (0, 5, 20, 2, 5, 20, 2, 0), True),  # a treatment of four levels
    ],
)
def test_a_column_that_varies_is_a_condition_unless_it_says_something_known(tmp_path, heading, values, kept):
    rows = zip((0, 1, 2, 4) * 2, values, (31.0, 35.0, 38.0, 36.0, 31.5, 35.5, 38.5, 36.5), strict=True)
    text = SALT.format(heading) + "".join(f"{w};{x};{a};0.5\n" for w, x, a in rows)
    found, assumed = measured(tmp_path, text)
    assert (len(found.conditions) == 2) is kept
    words = f"column '{heading}' is kept as a condition" if kept else f"not used: '{heading}' ("
    assert any(words in each for each in assumed)


@pytest.mark.parametrize(
    ("heading", "kept"), [("Lfd. Nr.", False), ("№ опыта", False), ("age (d)", True), ("passes", True)]
)
def test_a_number_that_counts_the_rows_is_no_condition_though_the_result_rises_with_it(
    tmp_path, heading, kept
):
    doses = (0, 1, 2, 4, 6, 8, 12, 16)
    rows = "".join(f"{k + 1};{x};{30 + 8 * (1 - 0.8**x):.2f};0.2\n" for k, x in enumerate(doses))
    text = f"{heading};polymer (g/m2);angle of repose (deg);SD\n{rows}"
    assert len(measured(tmp_path, text)[0].conditions) == 1 + kept
    alone = re.sub(r"(?m)^([^;]*);[^;]*", r"\1", text)
    assert len(measured(tmp_path, alone)[0].conditions) == 1, "the only condition is one"


def test_words_are_set_ups_where_the_condition_has_no_numbers_and_a_bracket_below_mean_sd_is_one(tmp_path):
    rows = "".join(f"{w};{d};{30 + d} (0.4)\n" for w in ("dry", "moist", "wet") for d in (2, 3))
    found, assumed = measured(tmp_path, f"moisture;diameter (mm);angle of repose (deg), mean (SD)\n{rows}")
    assert (found.sd.tolist(), len({*found.group})) == ([0.4] * 6, 3)
    assert "column 'moisture' names set-ups: its words are kinds" in assumed
    rows = "".join(f"{k};{'abc'[k // 2]};{k % 2};{30 + k};0.4\n" for k in range(6))
    found, _ = measured(tmp_path, f"Sample no.;Mulch;moisture (%);angle of repose (deg);sd\n{rows}")
    assert {*found.group} == {*"abc"}
    found, assumed = measured(tmp_path, "moisture (%);angle of repose (deg)\n1;31.0 ± 0.0\n2;33.0 ± 0.4\n")
    assert found.sd == pytest.approx([np.nan, 0.4], nan_ok=True)
    assert "a scatter of 0 counts as not stated, in row 2" in assumed


@pytest.mark.parametrize("cells", ["0.3 0.6", "±0.3 ± 0.6", "(0.3) (0.6)", "1% 2%"])
def test_a_column_of_scatter_is_read_as_laboratories_write_it(tmp_path, cells):
    first, second = cells.replace("± ", "±").split()
    found, _ = measured(tmp_path, f"moisture (%);repose angle (deg);SD\n1;30;{first}\n2;30;{second}\n")
    assert found.sd == pytest.approx([0.3, 0.6])


def test_dates_are_days_and_properties_of_soils_are_kept_beside_their_textures(tmp_path):
    days = zip(("3.2.2020", "4.2.2020", "4.2.2020", "5.2.2020"), (0, 1, 2, 4), strict=True)
    rows = "".join(f"{d};{w};{30 + w};0.5\n" for d, w in days)
    text = f"Datum;moisture (%);angle of repose (deg);SD\n{rows}"
    assert measured(tmp_path, text)[0].conditions["day"] == pytest.approx(86400.0 * np.array([0, 1, 1, 2]))
    for shared in (True, False):  # each moisture on a day of its own, or repeats on several days
        rows = "".join(
            f"{1 + (w if shared else k)}.2.2020;{w};{30 + w + k}\n" for w in range(4) for k in (0, 1)
        )
        found, assumed = measured(
            tmp_path, f"Datum;moisture (%);angle of repose (deg)\n{rows}", f"{shared}.csv"
        )
        assert ("day" in found.conditions) == shared
        assert ("not used: 'Datum' (repeats have several dates)" in assumed) != shared
    soils = zip("ABCD", "sand loam loam clay".split(), (2, 9, 14, 22), (0.21, 0.16, 0.14, 0.12), strict=True)
    rows = [f"{s};{t};{c};{d};{w};{30 + w + c / 3:.1f};0.5" for s, t, c, d in soils for w in (0, 2, 4)]
    text = "soil;texture;clay (%);d50 (mm);moisture (%);angle of repose (deg);SD\n" + "\n".join(rows)
    assert {"clay_fraction", "diameter", "moisture"} == {*measured(tmp_path, text)[0].conditions}


@pytest.mark.parametrize("heading", ["reps", "WDH", "重复", "Wiederholung"])
def test_numbers_that_tell_repeats_apart_count_none(tmp_path, heading):
    rows = "".join(f"{k};{w};{30 + w + 0.3 * k:.1f}\n" for w in (0, 1, 2, 4) for k in (1, 2, 3))
    found, _ = measured(tmp_path, f"{heading};moisture (%);angle of repose (deg)\n{rows}")
    assert (np.isnan(found.n).all(), [*found.conditions]) == (True, ["moisture"])


def test_rows_that_differ_in_any_column_that_acts_are_no_repeats(tmp_path):
    doses = "".join(f"{w};{x};{30 + w + 0.3 * (x or 0):.1f};\n" for w in (0, 2, 4, 6) for x in ("", 5, 10))
    assert "'gum (g)' is blank in 4 rows" in refused(tmp_path, SALT.format("gum (g)") + doses)
    factors = np.array([[(k >> bit) & 1 for bit in range(6)] for k in range(64)])
    lines = [",".join([*map(str, row), f"{30 + row @ [1, 2, 0.5, 3, 1.5, 4]:.1f}"]) for row in factors]
    text = "friction,bounce,modulus,poisson,rolling,energy,angle of repose (deg)\n" + "\n".join(lines)
    assert "no repeats differ" in refused(tmp_path, text)
    assert len(measured(tmp_path, text, sd={"repose_angle": "1 deg"})[0].conditions) == 6


def test_a_measured_condition_that_repeats_follow_or_hardly_any_row_repeats_is_kept(tmp_path):
    humidity = np.array([36.0, 49, 66, 82, 34, 51, 63, 79, 35, 52, 64, 81])
    salt = np.repeat([0.0, 1.0, 2.0], 4)
    angles = 31.0 + salt + 0.002 * (humidity - 30.0) ** 2 + 0.3 * np.cos(7.0 * humidity)
    rows = zip(salt, humidity, angles, strict=True)
    text = SALT.format("room humidity (%)") + "".join(f"{s};{h};{a:.1f};0.5\n" for s, h, a in rows)
    assert [len(np.unique(each)) for each in measured(tmp_path, text)[0].conditions.values()] == [3, 12]
    few = "1;36;30.4;1\n2;49;33.2;1\n2;66;33.9;1\n3;51;32.1;1\n4;82;34;1\n5;63;33.1;1\n"  # two equal ones
    assert len(measured(tmp_path, SALT.format("room humidity (%)") + few)[0].conditions) == 2


@pytest.mark.parametrize(
    ("plain", "heading", "words"),
    [
        ("SD", "± 95 % confidence", "is no sd of single repeats"),
        ("SD", "95% CI", "is no sd of single repeats"),
        ("SD", "Variance", "is no sd of single repeats"),
        ("SD", "IQR", "is no sd of single repeats"),
        ("SD", "2 SD", "is no sd of single repeats"),
        ("u*t [m/s],SD [m/s]", "τc [Pa],SD [Pa]", "give u*t = (stress / density of air)^1/2"),
        ("u*t [m/s],SD [m/s]", "tan of repose angle,SD", "is converted: write scatter behind each value"),
        ("u*t", "u*t x 10^2", "its numbers count in a power of ten"),
        ("moisture [%]", "moisture [% FC]", "'fc' makes it another quantity"),
        ("u*t", "u*t for dust emission", "'emission' makes it another quantity"),
    ],
)
def test_words_that_make_another_quantity_are_refused(tmp_path, plain, heading, words):
    rows = "".join(f"{d},{w},{u},0.01\n" for d, w, u in SANDS)
    assert words in refused(tmp_path, HEAD.replace(plain, heading) + rows)


@pytest.mark.parametrize("heading", ["moisture at sampling (%)", "Density (g/cm3)", "Ridge angle (°)"])
def test_a_condition_of_its_own_that_a_refusal_offers_is_one(tmp_path, heading):
    text = HEAD.replace("moisture [%]", heading) + "".join(f"{d},{w},{u},0.01\n" for d, w, u in SANDS)
    name, unit = re.findall("of your own --condition '(.*?)=(.*?)'", refused(tmp_path, text))[0]
    found, _ = measured(tmp_path, text, table_options=TableOptions(conditions={name: unit}))
    assert len(found.conditions) == 2
    assert "moisture" not in found.conditions


def test_words_that_recur_name_set_ups_and_numbers_are_what_their_sizes_allow(tmp_path):
    head = "crop,oven temperature (°C),n (%),s," + HEAD.replace("SD [m/s]", "SD (m/s)")
    cells = zip("aabbab", (5, 60, 5, 60, 60, 5), (46, 44, 45, 46, 44, 45), SANDS, strict=True)
    rows = (f"{crop},{t},{n},{40 + n},{d},{w},{u},0.01\n" for crop, t, n, (d, w, u) in cells)
    found, assumed = measured(tmp_path, head + "".join(rows))
    assert found.group == tuple("aabbab")
    assert np.isnan(found.n).all(), "a porosity counts no repeats"
    assert "oven_temperature" in found.conditions
    assert any("larger than those of 'u*t [m/s]'" in each for each in assumed)
    for names, groups in ((("tin", "zinc", "iron"), 3), (("P 1", "P 2", "P 3"), 1)):
        text = "".join(f"{name};{name};{30 + k};1\n" for k, name in enumerate(names))
        for kind in ("material;note", "note;type of grain"):
            found, _ = measured(tmp_path, f"{kind};angle of repose (deg);SD\n{text}")
            assert len({*found.group}) == groups, "words alone tell rows apart"


PROFILES = [
    "d (mm);u at 0.5 m (m/s);u at 1 m (m/s);flux (g/m/s)\n0.2;5;6;3\n0.3;5;6;3\n",
    "d (mm);height (m);wind speed (m/s);flux (g/m/s)\n0.2;0.5;6;3\n0.2;1;6.5;3\n",
    "d (mm);height (cm);u* (m/s);flux (g/m/s)\n0.2;5;0.4;3\n0.2;10;0.4;1\n",
    "d (mm);u* (m/s);flux at 5 cm (g/m/s);flux at 10 cm (g/m/s)\n0.2;0.4;5;6\n0.3;0.4;10;6\n",
]


@pytest.mark.parametrize("text", PROFILES)
def test_a_profile_is_one_measurement(tmp_path, text):
    told = refused(tmp_path, text, roughness="0.03 mm")
    assert "a profile over the height is one measurement" in told
    assert "roughness length of the bed" not in told
    once = "u*t (m/s);threshold wind at 2 m (m/s);threshold wind at 2 m, z0 known (m/s)\n0.2;5;6\n0.3;7;8\n"
    assert "profile" not in refused(tmp_path, once, roughness="0.03 mm"), "two winds at one height"
    sites = "".join(f"{z};{u};{40 * u - 7:.0f};1\n" for z in (5, 3800) for u in (0.4, 0.5, 0.6))
    assert "altitude" in measured(tmp_path, f"Elevation (m);u* (m/s);flux (g/m/s);sd\n{sites}")[0].conditions


def test_a_wind_over_beds_of_several_roughness_lengths_gives_the_friction_velocity_of_each(tmp_path):
    rows = ((0.05, 0.2, 5.6), (1.5, 0.2, 4.9), (8, 0.2, 5.2), (0.05, 2, 9.6), (1.5, 2, 8.3), (8, 2, 8.8))
    text = "z0 (mm);moisture (%);threshold wind speed at 2 m (m/s);sd\n"
    text += "".join(f"{z};{w};{u};0.2\n" for z, w, u in rows)
    found, _ = measured(tmp_path, text)
    factors = np.array([0.4 / log(2.0 / (1e-3 * z)) for z, *_ in rows])
    assert found.value == pytest.approx(factors * [u for *_, u in rows])
    assert found.value[:3] == pytest.approx([0.211, 0.272, 0.377], rel=2e-3)
    assert found.sd == pytest.approx(0.2 * factors)


def test_the_width_between_walls_reaches_the_model(tmp_path):
    rows = "5;0.5;31.5;0.5\n10;0.5;28.4;0.5\n80;0.5;26.9;0.5\n"
    found, _ = measured(tmp_path, f"cell thickness (mm);d (mm);angle of repose (deg);sd\n{rows}")
    study = load_study(tmp_path / "t" / "t.toml")
    assert study.file.conditions["width"] == "width"
    walls = study.problem.model("repose_angle", found.conditions, {}, {"side_walls": 1.0}, np.arange(3))
    assert walls.mean(axis=0)[0] > walls.mean(axis=0)[2] + 4.0
    for width in ({}, {"width": np.zeros(2)}):  # heaps without walls
        free = {"diameter": np.array([1e-4, 1e-2]), **width}
        assert not np.ptp(study.problem.model("repose_angle", free, {}, {"side_walls": 1.0}, np.arange(1)))


ANGLES = (31.0, 35.0, 38.0, 39.0, 40.0)
WET = "{};{};SD\n" + "".join(f"{w};{angle};0.5\n" for w, angle in enumerate(ANGLES))


@pytest.mark.parametrize(
    ("heading", "is_told"),
    [("moisture (%)", True), ("MC, wt%", True), ("moisture (% dry mass)", False), ("Feuchte (%), TS", False)],
)
def test_the_basis_of_a_moisture_is_told_where_its_heading_does_not_say_it(tmp_path, heading, is_told):
    _, assumed = measured(tmp_path, WET.format(heading, "repose angle (deg)"))
    assert any(f"'{heading}' counts as a share of dry soil" in line for line in assumed) is is_told


def test_repeats_that_a_heading_counts_are_those_of_every_row_and_of_no_numbered_sibling(tmp_path):
    found, _ = measured(tmp_path, WET.format("moisture (% dry mass)", "repose angle (deg, n = 5)"))
    assert list(found.n) == [5] * len(ANGLES)
    error = WET.format("moisture (%)", "repose angle (deg)").replace(";SD", ";SE (n = 4)")
    assert measured(tmp_path, error)[0].sd == pytest.approx([1.0] * len(ANGLES))
    numbered = "moisture (%);repose angle n=1 (deg);repose angle n=2 (deg)\n0;31;32\n1;35;34\n2;38;39\n"
    assert not np.isfinite(np.array(measured(tmp_path, numbered, "u.csv")[0].n, float)).any()


TILTED = "{};u*t (m/s);SD;d (mm)\n0{u};0.2;0.01;0.25\n5{u};0.22;0.01;0.25\n10{u};0.23;0.01;0.25\n"


@pytest.mark.parametrize("heading", ["slope (%)", "percent slope"])
def test_a_slope_in_per_cent_is_the_tangent_of_an_angle_and_told(tmp_path, heading):
    found, told = measured(tmp_path, TILTED.replace("{u}", "").format(heading))
    assert found.conditions["slope"] == pytest.approx(np.arctan([0.0, 0.05, 0.1]))
    assert "slopes in % count as angles" in " ".join(told)


@pytest.mark.parametrize("heading", ["flux", "sand transport rate"])
def test_a_quantity_of_several_usual_units_needs_its_own(tmp_path, heading):
    text = f"u* (m/s);{heading};SD;d (mm)\n0.3;5;0.4;0.25\n0.4;19;1.5;0.25\n0.6;79;6;0.25\n"
    assert f"write it there: '{heading} [UNIT]'" in refused(tmp_path, text)
    found, _ = measured(tmp_path, text, table_options=TableOptions(units={heading: "g/(m s)"}))
    assert found.value == pytest.approx([0.005, 0.019, 0.079])


def test_headings_of_a_tidy_table_are_called_by_names_and_read_once(tmp_path):
    head = 'observable,value,unit,sd,"moisture, wet basis [%]",drop height [mm],sd of drop height [mm]\n'
    rows = "".join(f"repose_angle,{a},deg,0.5,{10 * k},{50 + k % 2},2\n" for k, a in enumerate(ANGLES))
    assert "volumetric" in refused(tmp_path, (head + rows).replace("moisture, wet basis", "volumetric water"))
    found, _ = measured(tmp_path, head + rows)
    wet = 0.1 * np.arange(len(ANGLES))
    assert found.conditions["moisture"] == pytest.approx(wet / (1.0 - wet))
    assert found.conditions["drop_height"] == pytest.approx(0.05 + 1e-3 * (np.arange(len(ANGLES)) % 2))


def test_unread_columns_that_are_left_out_are_told_in_one_sentence(tmp_path):
    rows = zip(ANGLES, (20, "", 22, "", 24), (2020, 2020, 2021, 2021, 2022), strict=True)
    text = ";moisture (%);repose angle (deg);SD;room (°C);year\n"
    text += "".join(f"{k};{k};{a};0.5;{room};{year}\n" for k, (a, room, year) in enumerate(rows))
    (told,) = (line for line in measured(tmp_path, text)[1] if line.startswith("not used"))
    assert "'room (°C)' (it is not known in every row)" in told
    assert "'year' (it counts rows or years), '' (it counts rows or years)" in told


def speeds(heading: str, values: Mapping[object, float]) -> list[str | tuple]:
    """A table of threshold friction velocities [m/s], by the cells of other columns."""
    return [f"{heading};u*t (m/s);SD;n", *((x, u, 0.01, 4) for x, u in values.items())]


SINGLE = {"diameter": "0.2 mm"}  # where no column states that of the grains
COVERS = {0: 0.318, 5: 0.388, 10: 0.501, 15: 0.557, 20: 0.682, 30: 0.832, 40: 1.03}  # % -> m/s, 3 %


def test_what_may_be_computed_from_all_that_is_measured_is_asked(tmp_path):
    rows = speeds("bed stress (Pa)", {f"{1.2 * u * u:.4f}": u for u in COVERS.values()})
    assert "--condition 'bed stress=Pa'" in refused(tmp_path, rows, **SINGLE)
    options = TableOptions(conditions={"bed stress": "Pa"})
    assert "bed_stress" in measured(tmp_path, rows, table_options=options, **SINGLE)[0].conditions


def test_a_length_as_large_as_grains_is_not_a_condition_beside_an_assumed_grain(tmp_path):
    sizes = {0.12: 0.0, 0.18: 0.01, 0.25: 0.0, 0.36: 0.01, 0.5: 0.0, 0.71: 0.01}
    rows = speeds("shot mean (mm)", {d: round(0.47 * d**0.5 + more, 3) for d, more in sizes.items()})
    assert "'shot mean=grains.size.diameter'" in refused(tmp_path, rows)
    assert "shot_mean" in measured(tmp_path, rows, **SINGLE)[0].conditions


NAMED = "sample,moisture (%),angle of repose (deg),SD,n\n"
NAMED += "".join(f"T{w},{w},{30 + w},0.5,4\n" for w in range(4))
RUNNING = "no.,moisture (%),angle of repose (deg)\n" + "".join(f"{k},{k % 2},{30 + k}\n" for k in range(8))
SUMS = [(f"{NAMED}{{}},0.9,41.3,,\n", each) for each in ("F", "Tukey HSD", "LSD (p = 0.05)", "R2", "F值")]
SUMS += [(f"{RUNNING}{{}},1,34.0\n", each) for each in ("MW", "Ср.", "± s", "SD", "CV (%)")]


@pytest.mark.parametrize(("text", "label"), SUMS)
def test_a_row_of_a_statistic_is_no_measurement(tmp_path, text, label):
    rows = text.count("\n") - 1
    word = "slope" if text.startswith(NAMED) else "control"
    assert measured(tmp_path, text.format(word).replace(",,", ",0.5,4"), "s.csv")[0].size == rows
    assert f"row {rows + 1}, '{label}': the row sums up others" in refused(tmp_path, text.format(label))


@pytest.mark.parametrize("power", [1, 2])
def test_a_column_computed_from_the_result_and_a_condition_is_asked(tmp_path, power):
    levels = [(w, d) for w in range(5) for d in (0.2, 0.4)]
    rows = [(w, d, 0.5 * d**0.5 * (1 + w**0.5) + 0.01 * ((3 * w + d) % 0.7)) for w, d in levels]
    lines = [f"{w},{d},{u:.3f},{0.01 * u:.3f},{u**power / d:.3f}" for w, d, u in rows]
    text = "\n".join(["moisture (%),d (mm),u*t (m/s),SD,number B", *lines, ""])
    assert "column 'number B': it follows the measured quantity" in refused(tmp_path, text)
    others = [f"{line.rpartition(',')[0]},{k * 7 % 10}" for k, line in enumerate(lines)]
    assert measured(tmp_path, [text.partition("\n")[0], *others], "o.csv")[0].size == 10


def test_columns_that_differ_in_all_rows_alike_are_no_repeats(tmp_path):
    def text(rise: float) -> str:
        rows = "".join(f"{w},{30 + w},{30.4 + w + rise},{29.7 + w - rise}\n" for w in range(6))
        return (
            f"moisture (%),angle of repose M1 (deg),angle of repose M2 (deg),angle of repose M3 (deg)\n{rows}"
        )

    assert "'angle of repose M3 (deg)': they differ more than repeats" in refused(tmp_path, text(2.0))
    shuffled = text(0.0).replace("33,33.4,32.7", "32.7,33,33.4").replace("35,35.4,34.7", "34.9,34.6,35.3")
    assert measured(tmp_path, shuffled, "s.csv")[0].size == 18


def test_a_mean_of_some_rows_is_refused_and_a_table_of_means_is_not(tmp_path):
    text = f"{NAMED}T0 mean,0,30.2,0.5,8\n"
    assert "row 6, 'T0 mean': the row sums up others" in refused(tmp_path, text)
    for word in ("Mean", "A avg.", "MW", "Ø"):
        of_all = text.replace("T0 mean,0,30.2", f"{word},1.5,31.5")
        assert f"row 6, '{word}': the row sums up others" in refused(tmp_path, of_all)
    shuffled = text.replace("T3,3", "T3,0.5")
    for means in (text, shuffled):
        assert measured(tmp_path, re.sub(r"(?m)^(T\d),", r"\1 mean,", means), "m.csv")[0].size == 5


@pytest.mark.parametrize("mark", ["ditto", "do.", "dto.", '–"–', "同上", "↓"])
def test_a_ditto_mark_is_the_cell_above(tmp_path, mark):
    text = f"moisture (%);angle of repose (deg);SD\n0;30;0.5\n'';31;〃\n1;32;0.4\n{mark};33;0.4\n2;34;0.4\n"
    found, told = measured(tmp_path, text)
    assert ([*found.conditions["moisture"]], found.sd[1]) == ([0.0, 0.0, 0.01, 0.01, 0.02], 0.5)
    assert "ditto marks count as the cell above" in told


def test_words_beside_a_table_say_what_stands_behind_a_sign(tmp_path):
    rows = "".join(f"{w};{30 + w} ± 0.5\n" for w in range(6))
    text = f"Angles, mean {{}}\nmoisture (%);angle of repose (deg)\n{rows}"
    assert "make ± a standard error" in refused(tmp_path, text.format("± SE"))
    assert "± is '2 SD': write the sd of single repeats" in refused(tmp_path, text.format("± 2 SD"))
    assert np.all(measured(tmp_path, text.format("± SD"))[0].sd == 0.5)
    for sign, sd in (("± SE (deg, n = 9)", 1.5), ("± SEM (deg) n = 4", 1.0), ("± sensor error (deg)", 0.5)):
        assert np.allclose(measured(tmp_path, text.format("").replace("(deg)", sign))[0].sd, sd)


@pytest.mark.parametrize("heading", ["parameter", "variable", "observable"])
def test_a_long_table_is_read_by_the_words_of_its_rows(tmp_path, heading):
    rows = [f"T{w},angle of repose,{30 + w},deg,0.6,4,{w}" for w in range(5)]
    rows += [f"T{w},threshold friction velocity,{0.25 + w / 50},m/s,0.01,4,{w}" for w in range(5)]
    head = f"site,{heading},value,unit,sd,n"
    table = "\n".join([f"{head},moisture [%]", *rows, ""])
    assert "'SE': write the sd of single" in refused(tmp_path, table.replace(",sd,", ",SE,"))
    assert "stands in column 'unit'" in refused(tmp_path, table.replace(",sd,", ",SD [rad],"))
    long = "site,x,value\n" + "".join(f"T{w},moisture [%],{w}\nT{w},u*t [m/s],0.{w + 2}\n" for w in range(5))
    assert "below 'x': write one row per sample" in refused(tmp_path, long)
    found = measured(tmp_path, table)[0]
    assert {*found.observable} == {"repose_angle", "threshold_u_star"}
    assert (found.group[0], found.value[-1]) == ("T0", pytest.approx(0.33))
    flux = "\n".join([f"{head},u* [m/s]", *(f"A,sand flux,{k},g/(m s),0.1,4,0.{k}" for k in range(3, 8)), ""])
    assert "friction_velocity" in measured(tmp_path, flux, "flux.csv")[0].conditions
    letters = flux.replace("sand flux", "repose angle").replace("g/(m s)", "deg").replace("u* [m/s]", "w (%)")
    assert "moisture" in measured(tmp_path, letters.replace("value", "Value"), "w.csv")[0].conditions


def test_what_cannot_be_measured_and_what_is_hidden_is_refused(tmp_path):
    assert "outside [0.001, 10]" in refused(tmp_path, "moisture (%);u*t (m/s);SD\n0;0;0.01\n1;0.3;0.01\n")
    wide = "moisture (%);u*t (m/s);SD\n0;0.2;999\n1;0.3;0.01\n2;0.4;0.01\n"
    assert "a scatter of 999" in refused(tmp_path, wide)
    sand = "Sand (in);u*t (m/s);SD\n0.01;0.2;0.01\n0.03;0.3;0.01\n"
    assert "if 'Sand (in)' does" in refused(tmp_path, sand)
    book, content = openpyxl.Workbook(), io.BytesIO()
    for row in (("moisture (%)", "angle of repose (deg)", "SD"), (0, 31, 0.5), (1, 90, 0.5), (2, 36, 0.5)):
        book.active.append(row)
    book.active["B3"].font = openpyxl.styles.Font(strike=True)
    book.save(content)
    with pytest.raises(BadInput, match="row 3 is struck through"):
        measured(tmp_path, content.getvalue(), "t.xlsx")
    book.active.row_dimensions[3].hidden = True
    book.save(content)
    with pytest.raises(BadInput, match="row 3 is hidden"):
        measured(tmp_path, content.getvalue(), "t.xlsx")


def test_blocks_with_a_column_of_their_own_are_repeats_and_an_operator_makes_none(tmp_path):
    acid = np.random.default_rng(5).normal(7.0, 0.2, (3, 6))
    head = "block;moisture (%);pH;angle of repose (deg)"
    angles = [(b, w, 30 + w + b % 2 + 0.3 * ((w + b) % 3)) for b in range(3) for w in range(6)]
    blocks = [f"{b};{w};{acid[b, w]:.2f};{a:.1f}" for b, w, a in angles]
    found, told = measured(tmp_path, [head, *blocks])
    assert ([*found.conditions], found.size) == (["moisture"], 18)
    assert "'pH' (it differs between repeats" in " ".join(told)
    blocks = [f"{b};{w};{acid[b, w]:.1f}0;{a:.1f}" for b, w, a in angles]  # five values in 18 rows
    assert [*measured(tmp_path, [head, *blocks], "few.csv")[0].conditions] == ["moisture"]
    crossed = [(0, 3), (0, 12), (1, 3), (2, 0), (2, 12), (3, 0), (3, 3), (3, 12), (4, 0)]  # in parts
    rows = [f"{w};{c};{30 + w + k % 2};0.5" for k, (w, c) in enumerate(crossed)]
    clay = ["moisture (%);clay (%);angle of repose (deg);SD", *rows]
    assert "clay_fraction" in measured(tmp_path, clay, "clay.csv")[0].conditions
    rows = [f"{'AB'[k % 2]};{500 * k};{0.25 + 0.01 * k:.3f};0.01;3" for k in range(8)]
    heights = ["operator;altitude (m);u*t (m/s);SD;n", *rows]
    assert "altitude" in measured(tmp_path, heights, "h.csv", diameter="0.2 mm")[0].conditions


FALLS = "moisture (%);{};angle of repose (deg);SD\n"
FALLS += "".join(f"{w};{h};{30 + w + h};0.5\n" for w in (0, 1, 2) for h in (2, 5, 9))
PRODUCTS = {"PAM": (5, 10, 20), "lime": (500, 1000, 2000), "straw": (50, 100, 200)}
RATES = {f"{name};{x}": 0.3 + 0.05 * k for name, rates in PRODUCTS.items() for k, x in enumerate(rates)}
GUM = ["treatment;gum (g/m2);moisture (%);angle of repose (deg)"]
GUM += [f"T{x};{x or '-'};0.3;{30 + 0.2 * x}" for x in (0, 2, 5, 9, 20, 40)]
MEANS = np.array([[0.25], [0.29], [0.33], [0.36], [0.41], [0.47], [0.5]])
STRESS = ["moisture (%);u*t 1 (m/s);u*t 2 (m/s);u*t 3 (m/s);shear stress (Pa)"]
for w, u in enumerate(np.random.default_rng(3).normal(MEANS, 0.01, (7, 3)).round(3)):
    STRESS.append(f"{w};{';'.join(map(str, u))};{1.2 * u.mean().round(3) ** 2:.4f}")
LOSSES = {round(20.0 * u * u, 3): u for u in COVERS.values()}
KEPT = {  # what is shown -> a table, what is stated beside it, its conditions and the number of its rows
    "a length that no sand has": (speeds("rain (mm)", {0: 0.3, 5: 0.31, 25: 0.34}), {}, "diameter rain", 3),
    "doses of products in other steps": (speeds("product;rate (kg/ha)", RATES), SINGLE, "diameter rate", 9),
    "a dose that the control lacks": (GUM, {"sd": {"repose_angle": "1 deg"}}, "gum moisture", 5),
    "a length is no label": (FALLS.format("hauteur de chute (cm)"), {}, "hauteur_de_chute moisture", 9),
    "nor is a depth of a probe": (FALLS.format("probe depth (cm)"), {}, "moisture probe_depth", 9),
    "what follows from the mean of repeats side by side is none": (STRESS, SINGLE, "diameter moisture", 21),
    "a known one": (speeds("loss on ignition (%)", LOSSES), SINGLE, "diameter organic_fraction", 7),
}


@pytest.mark.parametrize(("rows", "stated", "names", "count"), KEPT.values(), ids=KEPT)
def test_conditions_of_a_table(tmp_path, rows, stated, names, count):
    found, _ = measured(tmp_path, rows, **stated)
    assert (sorted(found.conditions), found.size) == (names.split(), count)


DOSES = {0: 0.308, 100: 0.327, 200: 0.346, 500: 0.407, 1000: 0.507, 2000: 0.71}  # kg/ha -> m/s
FOLLOWED = dict.fromkeys(("flat residue cover (%)", "chlorophyll (µg/cm2)", "pile mass (g)"), COVERS)
FOLLOWED |= dict.fromkeys(("gypsum (kg/ha)", "age (d)", "gypsum"), DOSES)


@pytest.mark.parametrize(("heading", "values"), FOLLOWED.items(), ids=FOLLOWED)
def test_a_condition_that_the_result_follows_closely_is_computed_from_no_result(tmp_path, heading, values):
    column, _ = measured(tmp_path, speeds(heading, values), **SINGLE)[0].conditions.values()
    assert len(np.unique(column)) == len(values)


READINGS = [  # a condition, its cells, what is said of it
    ("d50 (µm)", "250 500 1.000", "'1.000' has two readings: write 1000 or 1.0000"),
    ("d50 (mm)", "2024-02-01 2024-04-03 2024-06-05", "is a date; if the spreadsheet made it"),
    ("mulch (g/m2)", "none 100 200", "'none' may mean 0: write that where it does"),
    ("density (g/cm3)", "1.3 1.5 1.7", "of the bulk or of the grains?"),
    ("slope (downhill positive) (deg)", "0 5 10", "'downhill positive' makes it another quantity"),
]
FRICTION = "static friction coefficient;angle of repose (deg);SD\n0.3;16;0.5\n0.5;26;0.5\n0.7;35;0.5\n"
STATES = "".join(f"{'wet' if w else 'dry'},{d},{w},{u},0.01\n" for d, w, u in SANDS)
REFUSED = [
    (speeds(text, dict(zip(cells.split(), (0.3, 0.4, 0.5), strict=False))), words)
    for text, cells, words in READINGS
]
REFUSED += [(TILTED.replace("{u}", " %").format("slope"), "(% of an angle is a tangent")]
REFUSED += [(WET.format("moisture (%)", "repose angle (%)"), "(% of an angle is a tangent")]
REFUSED += [(FRICTION, "which is calibrated: leave out --closed-form")]
REFUSED += [(f"state,{HEAD}{STATES}", "its words divide 'moisture [%]' into ranges")]


@pytest.mark.parametrize(("rows", "words"), REFUSED)
def test_what_has_two_readings_or_is_another_quantity_is_refused(tmp_path, rows, words):
    assert words in refused(tmp_path, rows)


@pytest.mark.parametrize("columns", ["static friction;restitution;0.2;0.4", "A;B;-1;+1;-1,41;1,41;0"])
def test_a_design_of_simulations_or_of_coded_levels_is_audited(tmp_path, columns):
    first, second, *levels = columns.split(";")
    rows = [(a, b, 30 + len(a + b), 0.5) for a in levels for b in levels]
    text = [f"{first};{second};angle of repose (deg);SD", *rows]
    assert "`taichi-erosion audit t.csv` checks its design" in refused(tmp_path, text)


def test_other_marks_of_spreadsheets_are_read(tmp_path):
    rows = "".join(f"|{t} min|{30 + w}|{0.05 * (30 + w)}|{w}|\n" for w, t in enumerate((0, 30, 60, 90)))
    found, _ = measured(tmp_path, f"|rest|安息角（°）|SD|moisture （％）|\n|---|:---|---|---|\n{rows}")
    assert found.conditions["moisture"] == pytest.approx([0.0, 0.01, 0.02, 0.03])
    assert found.sd == pytest.approx(0.05 * found.value)


def test_grains_lie_anywhere_in_their_class(tmp_path):
    rows = "".join(
        f"{d};{w};0.{k + 2}{w};0.01;4\n" for k, d in enumerate(("0.1-0.2", "0.25-0.5")) for w in (0, 2)
    )
    problem = closed_form_study(tmp_path, "sieve class (mm);moisture (%);u*t (m/s);SD;n\n" + rows)[0].problem
    errors, _ = condition_errors(comparison_rows(problem, problem.measurements))
    assert errors["diameter"] == pytest.approx(np.array([1e-4, 1e-4, 2.5e-4, 2.5e-4]) / 12**0.5)


def test_what_a_heap_has_beside_its_angle_is_asked_unless_it_is_set(tmp_path):
    densities = {701: 0, 655: 1, 729: 2, 612: 3, 688: 4, 640: 5}
    rows = "".join(f"{w};{x};{30 + w};0.5\n" for x, w in densities.items())
    text = SALT.format("bulk density (kg/m3)") + rows
    assert "column 'bulk density (kg/m3)': it may be a result of the heap" in refused(tmp_path, text)
    assert len(measured(tmp_path, text.replace("701", "612"))[0].conditions) == 2, "it is crossed"


def test_a_row_that_its_remark_excludes_and_a_dose_that_the_control_lacks_are_refused(tmp_path):
    text = "moisture (%);angle of repose (deg);SD;remarks\n0;30;0.5;\n2;33;0.5;\n4;51;0.5;outlier, excluded\n"
    assert "row 4, 'outlier, excluded'" in refused(tmp_path, text)
    flags = text.replace("remarks", "outlier?").replace("outlier, excluded", "yes")
    assert "column 'outlier?' marks rows: delete those" in refused(tmp_path, flags)
    rows = [f"salt{s};{s};{w};{30 + w + 2 * (s or 0)};0.5\n" for s in ("", 2, 6) for w in range(4)]
    text = f"treatment;salt content (g/kg);moisture (%);angle of repose (deg);SD\n{''.join(rows)}"
    assert "blank in 4 rows (2, 3, 4, 5)" in refused(tmp_path, text)


def test_rows_of_words_alone_and_rows_that_a_footnote_excludes_are_refused(tmp_path):
    rows = "".join(f"{k};{w};{30 + w};0.5\n" for k, w in enumerate(range(4), 1))
    text = f"Run;moisture (%);angle of repose (deg);SD\nSoil A;;;\n{rows}"
    assert "row 2, 'Soil A', has words alone: write it in each row below" in refused(tmp_path, text)
    stars = text.replace("Soil A;;;\n", "").replace(";32;", ";52*;")
    assert "exclude rows that are marked" in refused(tmp_path, f"{stars}* excluded from the fit;;;\n")
    assert measured(tmp_path, f"{stars}* p < 0.05. No outliers were found.;;;\n")[0].size == 4


def test_what_the_user_states_is_not_asked_again(tmp_path):
    rows = "".join(f"{0.9 + d % 2};{d};{0.3 * d};0;3\n" for d in range(1, 7))
    text = f"density (g/cm3);d (mm);u*t (m/s);SD;n\n{rows}"
    own = TableOptions(conditions={"density (g/cm3)": "materials.soil.density"})
    found, _ = measured(tmp_path, text, table_options=own, sd={"threshold_u_star": "3 %"})
    assert found.conditions["density"].min() == pytest.approx(900.0)
    assert found.sd == pytest.approx(0.03 * found.value), "a scatter of 0 states none"


def test_the_unit_of_a_heading_says_which_of_its_quantities_is_measured(tmp_path):
    text = "d (mm);Clay u*t (cm/s);SD;n\n" + "".join(f"{0.1 * k};{10 * k};1;n=3\n" for k in range(1, 7))
    assert "'n' has no numbers that can be read: 'n=3'" in refused(tmp_path, text)
    found, _ = measured(tmp_path, text.replace("n=", ""))
    assert set(found.observable) == {"threshold_u_star"}
