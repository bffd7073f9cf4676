"""One schema for calibrations and evidence studies, in a file; one number of a study changes alone."""

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest
from scene_tables import refusal

from taichi_erosion.campaign import study_file
from taichi_erosion.campaign.study_file import read_calibration_study, read_evidence_study, with_entry
from taichi_erosion.core.errors import BadInput

ROOT = Path(__file__).parents[2]
SCENE = (ROOT / "scenes" / "column_collapse.toml").read_text("utf-8")
BOTH = """
[study]
measurements = "heap.csv"
[observables.angle]
scene = "heap.toml"
measure = "repose_angle"
[parameters]
a = { start = 1.0, low = 0.5, high = 2.0 }
b = { start = 1.0, low = 0.5, high = 2.0 }
c = { start = 1.0, low = 0.5, high = 2.0, least = 0.1 }
[targets.angle]
value = 33.0
sd = 0.5
n = 5
[design]
confirm = 3
[vault]
fraction = 0.2
"""
TARGETS = "[targets.angle]\nvalue = 33.0\nsd = 0.5\nn = 5\n"
SCENE_ANSWERS = '"heap.csv"\n[observables.angle]\nscene = "heap.toml"\n'
MODEL_ANSWERS = '"heap.csv"\nmodel = "m:f"\n[observables.angle]\n'
STUDIES = sorted((ROOT / "doe").glob("*.toml"))
WRONG = [  # what both refuse
    ("[vault]", "[volt]", "volt is unknown; did you mean 'vault'?"),
    ("fraction = 0.2", "fractoin = 0.2", "vault.fractoin is unknown; did you mean 'fraction'?"),
    ("least = 0.1", "least = 0.7", "parameters.c: the limits (0.7, 2.0) must hold [0.5, 2]"),
]


def written(folder: Path, text: str) -> Path:
    path = folder / "study.toml"
    path.write_text(text, "utf-8")
    return path


def test_one_file_is_a_calibration_and_an_evidence_study(tmp_path):
    calibration = read_calibration_study(written(tmp_path, BOTH))
    assert calibration.study == read_evidence_study(calibration.path)
    assert calibration.study.parameters["c"].limits == (0.1, 2.0)
    assert calibration.scene("angle") == tmp_path / "heap.toml"
    assert calibration.measure("angle") == "repose_angle"


@pytest.mark.parametrize(
    ("read", "old", "new", "said"),
    [
        *((read_calibration_study, *entry) for entry in WRONG),
        *((read_evidence_study, *entry) for entry in WRONG),
        (read_calibration_study, TARGETS, "", "[targets] is missing"),
        (read_calibration_study, "sd = 0.5", 'sd = 0.5\nunit = "rad"', "its measure counts in deg"),
        (read_calibration_study, '"heap.csv"', '"heap.csv"\nmodel = "m:f"', "exactly one must answer"),
        (read_calibration_study, SCENE_ANSWERS, MODEL_ANSWERS, "study.model answers evidence studies alone"),
        (read_calibration_study, 'scene = "heap.toml"\n', "", "observables.angle.scene is missing, as"),
        (read_evidence_study, "start = 1.0, ", "", "parameters.a.start is missing"),
        (read_evidence_study, '"heap.csv"', '"heap.csv"\nsettings = ["a=1"]', "study.settings is read by a"),
        (read_evidence_study, "least = 0.1", 'also = ["d"]', "c.also is read by a calibration alone"),
    ],
)
def test_wrong_entries_and_what_a_command_lacks_or_does_not_read_are_named(tmp_path, read, old, new, said):
    assert said in refusal(read, written(tmp_path, BOTH.replace(old, new)))


def changed_lines(before: str, after: str) -> list[str]:
    return [line for line in after.splitlines() if line not in before.splitlines()]


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("contact", "grain-grain", "friction_rolling"), "friction_rolling = 0.25"),
        (("grains", "size", "diameter"), 'size = { law = "monodisperse", diameter = 0.25 }'),
    ],
)
def test_an_entry_changes_where_it_stands(path, line):
    assert changed_lines(SCENE, with_entry(SCENE, path, 0.25)) == [line]


def test_an_entry_that_is_not_there_gets_its_section_or_its_place_between_braces():
    path = ("effects", "liquid_bridge", "strength")
    after = with_entry(SCENE, path, 1.5)
    assert changed_lines(SCENE, after) == ["[effects.liquid_bridge]", "strength = 1.5"]
    assert changed_lines(SCENE, with_entry(after, path, 0.5)) == ["[effects.liquid_bridge]", "strength = 0.5"]
    # no comment between braces
    changed = with_entry("a = { b = 1.0, c = 2.0 }\n", ("a", "b"), 2.0, "calibrated")
    assert tomllib.loads(changed) == {"a": {"b": 2.0, "c": 2.0}}
    assert tomllib.loads(with_entry("a = { b = 1.0 }\n", ("a", "c"), 2.0)) == {"a": {"b": 1.0, "c": 2.0}}
    with pytest.raises(BadInput, match="set it by hand"):
        with_entry("a = 1.0\n", ("a", "c"), 2.0)


def test_a_comment_beside_a_changed_number_goes_and_all_others_stay():
    text = "[a] # heading\n# above\nb = 1.0   # measured by hand\nc = 2.0 # why\n"
    assert with_entry(text, ("a", "b"), 2.0) == text.replace("1.0   # measured by hand", "2.0")
    noted = with_entry(text, ("a", "b"), 2.0, "calibrated: 1 to 3, 90 %")
    assert noted == text.replace("1.0   # measured by hand", "2.0  # calibrated: 1 to 3, 90 %")
    assert with_entry(text, ("a", "b"), 1.0, "calibrated") == text, "an entry that has the value keeps it"


def test_the_schema_beside_the_studies_is_fresh(tmp_path):
    # ./erosion schema --study writes it
    study_file.write_study_schema(tmp_path / "fresh.json")
    assert (ROOT / "doe" / "study.schema.json").read_bytes() == (tmp_path / "fresh.json").read_bytes()


@pytest.mark.parametrize("study", STUDIES, ids=lambda path: path.stem)
def test_a_shipped_study_has_the_form_of_the_schema(study):
    table = json.loads(json.dumps(tomllib.loads(study.read_text("utf-8"))))
    jsonschema.validate(table, study_file.study_schema())
