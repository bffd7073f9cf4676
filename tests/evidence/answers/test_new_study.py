"""A stranger's table becomes a study; whatever is wrong with it is told in one line with place and remedy."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.core.errors import BadInput
from taichi_erosion.effect_library import load_library
from taichi_erosion.evidence.answers import check_study
from taichi_erosion.evidence.answers.new_study import NewStudyOptions, write_new_study
from taichi_erosion.evidence.answers.scene_templates import TEMPLATES, least_grain_count, scene_text
from taichi_erosion.evidence.answers.written_files import EXPECTED_AS
from taichi_erosion.evidence.data.tables.column_roles import TableOptions
from taichi_erosion.evidence.models.load_study import Study, load_study
from taichi_erosion.execution.checks import read_scene

ROOT = Path(__file__).parents[3]
HEAD = "Probe;Korngröße [µm];Feuchte in %;Böschungswinkel (°);SD [°];n\n"
ROWS = ("A;250;1,6;33,5;0,7;5\n", "B;500;0;31,2;0,8;5\n", "C;800;3,1;34,4;0,6;5\n")
GOOD = HEAD + "".join(ROWS)


def guess(_question: str, answer: str) -> str:
    return answer


@pytest.fixture(autouse=True)
def uncounted(monkeypatch) -> None:
    """No cost of the runs of a study on scenes: their plans take seconds."""
    monkeypatch.setattr(check_study, "discovery_cost", lambda *_: {})


def changed(old: str, new: str) -> bytes:
    assert old in GOOD
    return GOOD.replace(old, new, 1).encode("cp1252")


def made(folder: Path, text: str, wishes: NewStudyOptions, answer=guess) -> tuple[dict, Study]:
    (folder / "t.csv").write_text(text, encoding="utf-8")
    document = write_new_study(folder / "t.csv", wishes, answer)
    return document, load_study(Path(document["written"][0]))


def faults_of(folder: Path, content: bytes, wishes: NewStudyOptions | None = None) -> tuple[str, ...]:
    (folder / "heap.csv").write_bytes(content)
    with pytest.raises(BadInput) as caught:
        write_new_study(folder / "heap.csv", wishes or NewStudyOptions(closed_form=True), guess)
    return caught.value.faults


WARM = GOOD.replace("Feuchte in %", "Temperatur [K]").replace("1,6", "20").replace(";0;", ";15;")
WINDY = GOOD.replace("Böschungswinkel (°)", "u at 1 m [m/s]").replace("[°]", "[m/s]")
# content of the file -> place of the fault, its remedy
WRONG_FILES = [
    (b"", "heap.csv", "the first row names the columns"),
    (HEAD.encode("cp1252"), "heap.csv", "no measured value"),
    (b"\xd0\xcf\x11\xe0" + bytes(600), "heap.csv", "save it as .xlsx or .csv"),
    (b"PK\x03\x04" + bytes(600), "heap.csv", "save it again"),
    (changed("A;250", '"A;250'), "row 2", "look for a lone quote"),
    (changed(";Korngröße [µm];", ";;"), "column 2 has no heading", "name it"),
    (changed("Feuchte in %", "Korngröße [µm]"), "'Korngröße [µm]'", "each its own name"),
    (changed("[µm]", "[fein]"), "'Korngröße [fein]'", "such as [%], [mm]"),
    (changed("[µm]", "[MM]"), "'Korngröße [MM]'", "did you mean 'mm'?"),
    (changed("Feuchte in %", "w"), "column 'w'", "did you mean conditions.moisture?"),
    (changed("in %", "[vol%]"), "'Feuchte [vol%]'", "divide by the dry bulk density"),
    (changed("1,6", "1600"), "row 2, moisture = 1600 %", "check number and unit"),
    (changed("33,5", "12. Mrz"), "row 2, Böschungswinkel", "set the column to text"),
    (changed("33,5", "n.n."), "row 2, Böschungswinkel", "write '<' and the least value"),
    (changed("33,5", "~32"), "= '~32' is no certain number", "behind ±"),
    (changed("33,5", "35..32"), "row 2, Böschungswinkel", "first number must be below"),
    ((GOOD + "D;1;1;33;1;5\n").replace(";5\n", ";2,5\n").encode("cp1252"), "row 2, n =", "; 3 rows more"),
    (changed("33,5", "33,5 (0,7)"), "row 2, Böschungswinkel", "31.2 ± 0.8"),
    (changed("250", "250 mg"), "row 2, Korngröße [µm]", "a column in µm"),
    (changed("0,7", "-0,7"), "row 2, SD [°] = '-0,7'", "leave it empty"),
    (changed("0,7;5", "0,7;0"), "row 2, n = '0'", "a whole number from 1"),
    (GOOD.encode("cp1252") + b"Mittelwert;;;33,0;;\n", "row 5, 'Mittelwert'", "remove it"),
    (changed("Böschungswinkel", "Dings"), "heap.csv", "--observable 'COLUMN=NAME'"),
    (changed("SD [°]", "SD [mm]"), "row 2, SD [mm]", "in a column in °"),
    (changed("[µm]", "[mm]"), "row 2, diameter = 250 mm", "mean [um]?"),
    (WARM.encode("cp1252"), "row 2, temperature = 20 K", "did you mean [degC]?"),
    (WINDY.encode("cp1252"), "'u at 1 m [m/s]': a wind at 1 m is no friction velocity", "--roughness"),
    (GOOD.encode("cp1252") + b"Probe;Ort\nA;Nord\n", "row 5", "one table in a file"),
]


@pytest.mark.parametrize(("content", "place", "remedy"), WRONG_FILES)
def test_what_is_wrong_with_a_table_is_told_with_its_place_and_remedy(tmp_path, content, place, remedy):
    faults = faults_of(tmp_path, content)
    assert all(fault.startswith("heap.csv") and "\n" not in fault for fault in faults)
    assert any(place in fault and remedy in fault for fault in faults), faults
    assert [path.name for path in tmp_path.iterdir()] == ["heap.csv"], "nothing is written"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("heap.csv --observable W=repose_angle", "--observable W.*there are: Probe"),
        ("heap.csv --observable Winkel", "--observable Winkel.*write it as COLUMN=NAME"),
        ("heap.csv --apparatus bucket", "--apparatus bucket: measures none.*one of cylinder, funnel"),
        ("other.csv", r"other\.csv.*no such file"),
        ("heap.csv --out taken", "taken/heap_tidy.csv: its folder cannot be made"),
        ("heap.csv --closed-form --grains 9", "--grains: has no use"),
    ],
)
def test_a_wrong_option_is_told_with_what_is_allowed(tmp_path, monkeypatch, capsys, words, told):
    (tmp_path / "heap.csv").write_bytes(GOOD.encode("cp1252"))
    (tmp_path / "taken").touch()
    monkeypatch.chdir(tmp_path)
    assert main(["study", "new", "--yes", *words.split()]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(told, line)


def test_faults_of_every_layer_are_told_at_once(tmp_path):
    text = GOOD.replace("Feuchte", "Fechte").replace("33,5", "3O,5").replace("31,2", "-31,2") + "D;300;1\n"
    told = faults_of(tmp_path, text.encode("cp1252"))
    places = ("row 5 has 3 cells, the heading 6", "'Fechte in %'", "'3O,5'", "-31.2 deg, outside [0, 90]")
    assert all(any(place in fault for fault in told) for place in places), told


def test_a_unit_that_the_user_states_counts(tmp_path):
    text = GOOD.replace(" [µm]", "").replace("800;", "40;").replace("50", "2")
    made(tmp_path, text, NewStudyOptions(TableOptions(units={"Korngröße": "mm"}), closed_form=True))
    assert "diameter [mm]" in (tmp_path / "t" / "t_tidy.csv").read_text("utf-8")


def test_a_condition_without_a_unit_is_refused_and_one_that_the_closed_form_does_not_read_is_told(tmp_path):
    (fault,) = faults_of(tmp_path, changed("Feuchte in %", "Feuchte"))
    assert "has no unit in its heading: its numbers are 0 to 3.1" in fault
    doc, _ = made(tmp_path, GOOD.replace("Feuchte in %", "Tongehalt in %"), NewStudyOptions(closed_form=True))
    kept = "column 'Tongehalt in %' is kept as a condition; no effect of the model reads it"
    assert kept in doc["assumed"]
    own = NewStudyOptions(TableOptions(conditions={"Temperatur": "g/kg"}), tmp_path / "own", closed_form=True)
    _, study = made(tmp_path, GOOD.replace("Feuchte in %", "Temperatur"), own)
    assert study.file.conditions["temperatur"] == "conditions.temperatur", "what the user says counts"


def test_a_wind_at_a_height_becomes_a_friction_velocity_by_the_law_of_the_wall(tmp_path):
    text = "Korngröße [µm];u at 1 m [m/s];sd;n\n250;6;0,3;5\n400;8;0,4;5\n600;10;0,5;5\n"
    document, study = made(tmp_path, text, NewStudyOptions(closed_form=True, roughness="0.02 mm"))
    factor = 0.4 / math.log(1.0 / 2e-5)
    assert study.problem.measurements.value == pytest.approx(factor * np.array([6.0, 8.0, 10.0]))
    assert study.problem.measurements.sd == pytest.approx(factor * np.array([0.3, 0.4, 0.5]))
    assert any("becomes a friction velocity" in words for words in document["assumed"])


SCENES = [(name, TEMPLATES[name].diameter, density) for name in TEMPLATES for density in (None, 7800.0)]
LARGEST = [("threshold", 5e-3, None), ("impact", 1.5e-3, None), ("saltation", 5e-3, None)]


@pytest.mark.parametrize(("name", "diameter", "density"), [*SCENES, *LARGEST])  # m, kg m-3
def test_a_scene_made_for_a_table_is_valid_and_large_enough_for_its_angle(tmp_path, name, diameter, density):
    """Steel falls hard; wind over large grains needs a lid above them and a rest that is no fall."""
    template = TEMPLATES[name]
    grains = least_grain_count(template, [26.0])
    assert grains >= template.grains
    text = scene_text(template, {"title": "t"}, [diameter], grains, density)
    (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
    scene = read_scene(tmp_path / "scene.toml", ())
    assert set(template.observables) <= set(scene.measure) | {"repose_angle"}


def test_a_new_study_on_a_scene_is_complete_and_its_conditions_arrive(tmp_path):
    told = TableOptions(conditions={"Feuchte in %": "conditions.moisture"})
    document, study = made(tmp_path, GOOD, NewStudyOptions(told))
    assert study.problem.measurements.conditions["diameter"] == pytest.approx([250e-6, 500e-6, 800e-6])
    assert study.problem.measurements.conditions["moisture"] == pytest.approx([0.016, 0.0, 0.031])
    assert "liquid_bridge" in document["candidates"]
    assert "side_walls" in document["candidates"]
    assert "turbulent_gusts" not in document["candidates"], "no wind blows over a heap"
    options = NewStudyOptions(told, tmp_path / "p", "funnel")
    box, _ = made(tmp_path, GOOD.replace("Korngröße", "note"), options)
    assert "side_walls" not in box["candidates"], "they would cut a fill"


HEAPS = (
    "Feuchte [%];d50 [mm];Haufenhöhe [mm];Haufendurchmesser [mm]\n"
    "0;1;4,1;20,4\n0,5;1;4,4;20\n1;1;4,6;19,6\n0;2;8;40,6\n0,5;2;8,4;40\n1;2;8,5;39,2\n"
)
SPREAD = {"Haufenhöhe": "2 %"}


def test_what_is_measured_at_one_heap_is_of_one_apparatus(tmp_path):
    document, study = made(tmp_path, HEAPS, NewStudyOptions(sd=SPREAD))
    assert {each.scene for each in study.file.observables.values()} == {"cylinder.toml"}
    assert "diameters of heaps are halved: runout_radius is a radius" in document["assumed"]
    wishes = NewStudyOptions(TableOptions({"Winkel": "angle_of_repose"}), tmp_path / "a", sd=SPREAD)
    _, study = made(tmp_path, HEAPS.replace("Haufendurchmesser [mm]", "Winkel [deg]"), wishes)
    assert {each.scene for each in study.file.observables.values()} == {"collapse.toml"}


def test_every_observable_has_effects_that_the_literature_expects_to_change_it():
    expected = {name for effect in load_library().values() for name in effect.expected}
    for template in TEMPLATES.values():
        for name in template.observables:
            assert EXPECTED_AS.get(name, name) in expected, name


FRICTION = "run;mu_s;mu_r;d (mm);grain density (g/cm3);runout (mm);sd\n"
FRICTION += "1;0,3;0,1;2;2,5;40;1\n2;0,6;0,1;2;2,7;35;1\n3;0,9;0,1;3;2,6;33;1\n"


def test_columns_of_friction_and_density_set_the_contacts_and_the_material_of_the_apparatus(tmp_path):
    wishes = NewStudyOptions(TableOptions({"runout": "runout_radius"}), apparatus="collapse", grains=700)
    document, study = made(tmp_path, FRICTION, wishes)
    assert study.file.conditions["friction_sliding"] == "contact.grain-grain.friction_sliding"
    assert study.file.conditions["density"] == "materials.grain.density"
    assert study.problem.measurements.conditions["density"] == pytest.approx([2500.0, 2700.0, 2600.0])
    assert document["parameters"] == [], "what the table states is not calibrated"
    assert read_scene(tmp_path / "t" / "collapse.toml", ()).grains.count == 700


def test_a_number_that_is_calibrated_and_set_by_a_column_is_refused(tmp_path):
    wishes = NewStudyOptions(TableOptions({"runout": "runout_radius"}), apparatus="collapse")
    path = made(tmp_path, FRICTION, wishes)[1].path
    number = "contact.grain-grain.friction_sliding"
    with path.open("a", encoding="utf-8") as file:
        file.write(f'\n[parameters."{number}"]\nstart = 0.5\nlow = 0.1\nhigh = 1.0\n')
    with pytest.raises(BadInput, match=f"parameters.{number}: column 'friction_sliding' sets it too"):
        load_study(path)


HEIGHTS = "run;moisture (%);pile height (mm);sd\n1;0;20;1\n2;1;22;1\n3;2;25;1\n"


def test_an_answer_that_is_none_is_asked_again_at_a_terminal_and_refused_in_a_pipe(tmp_path):
    answers, asked, table = ["Trichter", "cylinder", "viel", "0,8 mm"], list[str](), tmp_path / "t.csv"
    table.write_text(HEIGHTS, encoding="utf-8")
    wishes = NewStudyOptions(density="2.5 g/cm3", grains=900)
    write_new_study(table, wishes, lambda words, _: asked.append(words) or answers.pop(0), at_terminal=True)
    assert ("'Trichter' is not one of cyl" in asked[1], "'viel': write a number" in asked[3]) == (True, True)
    scene = read_scene(tmp_path / "t" / "cylinder.toml", ())
    assert (scene.grains.size.diameter, scene.grains.count) == (pytest.approx(8e-4), 900)
    assert scene.materials["soil"].density == pytest.approx(2500.0)
    with pytest.raises(BadInput, match="pile_height: 'Trichter' is not one of cylinder"):
        write_new_study(table, replace(wishes, anew=True), lambda *_: "Trichter")


@pytest.mark.parametrize(
    ("wishes", "said"),
    [
        ({"diameter": "4"}, "--diameter '4': write a number and its unit, such as '2 mm'"),
        ({"density": "2.65 kg/m3"}, "2.65 kg/m3 is outside [25, 30000]"),
        ({"diameter": "2 mm", "apparatus": "funnel"}, "have sizes of their own"),
    ],
)
def test_grains_that_cannot_be_are_refused_in_one_line(tmp_path, wishes, said):
    (fault,) = faults_of(tmp_path, HEIGHTS.encode(), NewStudyOptions(**({"apparatus": "cylinder"} | wishes)))
    assert said in fault


ROOTS = "Wurzelmasse;d [mm];repose angle [deg];sd\n0;1;31;1\n2;1;32;1\n4;2;33;1\n"


def test_a_condition_that_no_scene_has_enters_by_its_unit(tmp_path):
    _, study = made(tmp_path, ROOTS, NewStudyOptions(TableOptions(conditions={"Wurzelmasse": "g/kg"})))
    assert study.file.conditions["wurzelmasse"] == "conditions.wurzelmasse"
    assert read_scene(tmp_path / "t" / "cylinder.toml", ()).conditions.extra["wurzelmasse"].unit == "g/kg"
    assert study.problem.measurements.conditions["wurzelmasse"] == pytest.approx([0.0, 2.0, 4.0])


def test_a_scene_a_condition_and_an_effect_of_ones_own_make_a_study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fall.toml").write_bytes((ROOT / "doe" / "own_effect" / "fall.toml").read_bytes())
    assert main(["effects", "new", "my_pull", "--place", "scene"]) == 0
    text = "pore volume [mm3/g];settling velocity [m/s];sd\n0;1,91;0,1\n100;1,8;0,1\n200;1,7;0,1\n"
    folder, pull = tmp_path / "deep" / "er", (Path("my_pull.py"),)
    _, study = made(tmp_path, text, NewStudyOptions(scene=Path("fall.toml"), effects=pull, folder=folder))
    assert study.file.study.effect_files == ("../../my_pull.py",)
    assert study.file.observables["settling_velocity"].scene == "../../fall.toml"
    assert study.problem.measurements.conditions["pore_volume"] == pytest.approx([0.0, 0.1, 0.2])
    assert "my_pull" in study.problem.candidate_names
    assert not list(folder.glob("fall*"))


def test_a_condition_that_an_own_scene_does_not_declare_is_told(tmp_path):
    scene = ROOT / "doe" / "own_effect" / "fall.toml"
    wishes = NewStudyOptions(TableOptions(conditions={"roots": "g/kg"}), scene=scene)
    (fault,) = faults_of(tmp_path, b"roots [g/kg];settling velocity [m/s]\n0;1.9\n2;1.8\n", wishes)
    assert "does not declare the condition 'roots'; write [conditions.extra]" in fault


def test_a_slope_without_a_unit_is_asked_for_whatever_the_table_and_the_model(tmp_path):
    """Degrees, radians and per cent are as usual; the closed form would count in radians."""
    lines = "threshold_u_star,0.25,0.01,3,m/s,0\nthreshold_u_star,0.26,0.01,3,m/s,10\n"
    own = "slope,threshold u* [m/s],sd [m/s],n\n0,0.25,0.01,3\n10,0.26,0.01,3\n"
    for name, text in (("own", own), ("tidy", f"observable,value,sd,n,unit,slope\n{lines}")):
        with pytest.raises(BadInput, match=r"'slope':? has no unit .*such as deg"):
            made(tmp_path, text, NewStudyOptions(closed_form=True))
        wishes = NewStudyOptions(folder=tmp_path / name, closed_form=True)
        document, _ = made(tmp_path, text.replace("slope", "slope [deg]"), wishes)
        assert document["conditions"]["slope"] == "0 to 10 deg"


def test_a_column_that_no_effect_of_scenes_reads_is_a_condition_but_for_blanks(tmp_path):
    head = "diameter [mm],salt content [g/kg],repose angle [deg],sd"
    rows = "\n1,,28,0.6\n1,5,28.4,0.5\n2,5,27,0.5\n"
    document, _ = made(tmp_path, head + rows, NewStudyOptions())
    assert list(document["conditions"]) == ["diameter"]
    assert "not used: 'salt content [g/kg]' (it is not known in every row)" in document["assumed"]
    with pytest.raises(BadInput, match="is blank in row 2"):
        made(tmp_path, head.replace("salt content [g/kg]", "moisture [%]") + rows, NewStudyOptions())
    _, study = made(
        tmp_path, head.replace("salt", "straw") + rows.replace(",,", ",0,"), NewStudyOptions(anew=True)
    )
    assert study.problem.measurements.conditions["straw_content"].tolist() == [0.0, 5.0, 5.0]
    assert read_scene(tmp_path / "t" / "cylinder.toml", ()).conditions.extra["straw_content"].unit == "g/kg"


SIZES = """angle_of_repose [deg],radius_90 [mm],sd angle_of_repose,sd radius_90 [mm],size_spread,d [mm],n
24.1,19.4,0.6,0.2,0,1.5,3
23.7,19.6,0.6,0.2,0.2,1.5,3
20.9,20.7,0.6,0.2,0.4,1.5,3
"""
COLLAPSE = NewStudyOptions(TableOptions(conditions={"size_spread": "1"}), apparatus="collapse", grains=900)


def test_errors_between_codes_and_measured_numbers_enter_the_study_and_a_spread_its_effect(tmp_path):
    stated = {"between_codes": {"angle_of_repose": "1 deg", "radius_90": "5 %"}}
    stated |= {"measured": {"sliding_friction": "0.6 ± 0.06"}}
    document, study = made(tmp_path, SIZES, replace(COLLAPSE, **stated))
    seen = {o.name: (o.sd_shared, o.sd_shared_relative) for o in study.problem.observables.values()}
    assert seen == {"repose_angle": (1.0, 0.0), "radius_90": (0.0, 0.05)}
    for each in study.problem.parameters:  # of the grains in both apparatus
        if each.path.endswith("friction_sliding"):
            assert (each.start, each.prior_sd_log) == pytest.approx((0.6, 0.1))
    assert "size_distribution" in document["candidates"]


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({"between_codes": {"pile_height": "5 %"}}, "none of repose_angle, radius_90"),
        ({"between_codes": {"radius_90": "1 deg"}}, "number and its unit"),
        ({"measured": {"sliding_friction": "0.6"}}, "NUMBER=0.5 ± 0.05"),
        ({"measured": {"friction": "0.6 ± 0.1"}}, "NUMBER=0.5 ± 0.05"),
        ({"measured": {"sliding_friction": "3 ± 0.1"}}, "0.1 to 1.2"),
    ],
)
def test_an_error_or_a_number_that_fits_nothing_is_refused(tmp_path, stated, words):
    assert words in faults_of(tmp_path, SIZES.encode(), replace(COLLAPSE, **stated))[0]
