"""A calibration on a model whose answer is known finds what matters and hits the target."""

import re
from pathlib import Path

import closed_form
import pytest
import tomli_w
from run.small_scene import SCENE

from taichi_erosion.campaign import execute
from taichi_erosion.campaign.calibration import calibrate
from taichi_erosion.campaign.study_file import read_calibration_study
from taichi_erosion.cli.main import ExitCode, main
from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.design_table import read_design
from taichi_erosion.report import write_report
from taichi_erosion.report.calibration_page import publish

TARGET = 31.0  # deg
STUDY = {
    "study": {"seed": 5},
    "observables": {"repose_angle": {"scene": "few.toml"}},
    "targets": {"repose_angle": {"value": TARGET, "sd": 0.5, "n": 10, "unit": "deg"}},
    "parameters": {
        "materials.soil.shear_modulus": {"low": 1e6, "high": 2e6, "unit": "Pa"},
        "contact.soil-soil.restitution": {"low": 0.2, "high": 0.6},
        "contact.soil-soil.friction_sliding": {"low": 0.3, "high": 0.7},
        "contact.soil-soil.friction_rolling": {"low": 0.5, "high": 0.9, "most": 1.5},
        "contact.soil-steel.friction_sliding": {"low": 0.15, "high": 0.55, "most": 1.0},
    },
    "design": {"climb_steps": 4, "confirm": 8},
}
MATTER = {
    "contact.soil-soil.restitution",
    "contact.soil-soil.friction_rolling",
    "contact.soil-steel.friction_sliding",
}


def write_study(folder: Path, **sections) -> Path:
    (folder / "few.toml").write_text(tomli_w.dumps(SCENE), encoding="utf-8")
    path = folder / "study.toml"
    path.write_text(tomli_w.dumps(STUDY | sections), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("calibration")


@pytest.fixture(scope="module")
def found(folder):
    return calibrate(write_study(folder), workers=1, function=closed_form.FUNCTION)


def test_the_screening_keeps_the_parameters_that_matter(found):
    assert {factor.path for factor in found.screening.kept} == MATTER


def test_the_climb_ends_nearer_to_the_target_than_it_begins(found):
    path = found.climb
    distances = abs(path.design.responses["repose_angle"] - TARGET)
    assert path.best > 0
    assert distances[path.best] < distances[0] - 1.0


def test_the_optimum_meets_the_target_in_truth_and_not_only_on_the_fitted_surface(found):
    settings = found.confirmed.optimum.settings
    contact = {"soil-soil": {}, "soil-steel": {}}
    for path in MATTER:
        _, pair, name = path.split(".")
        contact[pair][name] = settings[path]
    # the surface rests on 17 runs: its prediction is good to about 2 sd / sqrt(17 / 10) of the noise
    assert closed_form.angle(contact) == pytest.approx(TARGET, abs=2.0 * closed_form.NOISE)


def test_fresh_seeds_confirm_the_optimum(found):
    test = found.confirmed.tests["repose_angle"]
    assert test.runs.n == STUDY["design"]["confirm"]
    assert abs(test.difference) < 3.0 * closed_form.NOISE


def test_no_two_runs_share_their_noise(found, folder):
    lines = (folder / "study" / "runs.csv").read_text(encoding="utf-8").splitlines()
    seeds = [line.split(",")[2] for line in lines[1:]]
    assert len(set(seeds)) == len(seeds) == found.document["runs"]


def test_the_tables_hold_the_designs_with_their_responses(found, folder):
    for name, design in (("screen", found.screening.design), ("surface", found.surface.design)):
        kept = read_design(folder / "study" / f"{name}.csv")
        assert kept.coded == pytest.approx(design.coded)
        assert kept.responses["repose_angle"] == pytest.approx(design.responses["repose_angle"])


def test_a_step_called_again_runs_nothing_and_says_the_same(found, folder, monkeypatch):
    monkeypatch.setattr(execute, "start_pool", None)  # whoever starts workers fails
    again = calibrate(folder / "study.toml", workers=1, function=closed_form.FUNCTION)
    timing = {"wall_s", "cpu_s"}
    assert {k: v for k, v in again.document.items() if k not in timing} == {
        k: v for k, v in found.document.items() if k not in timing
    }


def test_the_page_holds_every_step_and_its_pictures(found, folder):
    text = publish(found).read_text(encoding="utf-8")
    for part in ("Screening", "Steepest ascent", "Response surface", "Optimum", "Confirmation"):
        assert f"## {part}" in text
    pictures = re.findall(r"\]\(([^)]+)\)", text)
    assert len(pictures) == 8
    assert all((folder / "study" / picture).stat().st_size > 1000 for picture in pictures)


def test_the_design_alone_runs_nothing(tmp_path, capsys):
    study = write_study(tmp_path)
    assert main(["doe", "design", str(study)]) == ExitCode.SUCCESS
    assert "friction_rolling" in capsys.readouterr().out
    assert sorted(path.name for path in (tmp_path / "study").iterdir()) == ["screen.csv"]


@pytest.mark.parametrize(
    ("sections", "said"),
    [
        ({"targets": {"pile_height": {"value": 1.0, "sd": 0.1, "n": 3}}}, "targets.pile_height"),
        ({"design": {"climb_stepz": 4}}, "design.climb_stepz is unknown"),
        ({"parameters": {"a": {"low": 2.0, "high": 1.0}}}, "is not below high"),
        ({"targets": {"repose_angle": {"value": "steep", "sd": 0.1, "n": 3}}}, "must be a number"),
    ],
)
def test_a_wrong_entry_of_a_study_gives_one_clear_line(tmp_path, sections, said):
    with pytest.raises(BadInput, match=said) as refusal:
        read_calibration_study(write_study(tmp_path, **sections))
    assert "\n" not in str(refusal.value)
    assert "study.toml" in str(refusal.value)


def test_a_parameter_that_the_scene_does_not_know_is_refused_before_anything_runs(tmp_path):
    strange = STUDY["parameters"] | {"contact.soil-soil.stickiness": {"low": 0.1, "high": 0.2}}
    with pytest.raises(BadInput, match="stickiness"):
        calibrate(write_study(tmp_path, parameters=strange), workers=1, function=closed_form.FUNCTION)


def test_a_study_without_its_own_sections_is_told_what_is_missing(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(tomli_w.dumps({k: v for k, v in STUDY.items() if k != "targets"}), encoding="utf-8")
    with pytest.raises(BadInput, match=r"\[targets\] is missing"):
        read_calibration_study(path)


def test_sections_of_the_evidence_commands_are_left_to_them(tmp_path):
    path = write_study(tmp_path, candidates={"effects": "all"}, vault={"fraction": 0.3})
    assert read_calibration_study(path).study.targets["repose_angle"].value == TARGET


def test_the_report_is_the_page_with_its_pictures_inside(found):
    publish(found)
    page = write_report(found.file.path).read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == len(list((found.file.folder / "pictures").glob("*.png")))
    assert "<table>" in page
    assert 'src="pictures' not in page


def test_a_report_before_the_calibration_is_refused(tmp_path):
    with pytest.raises(BadInput, match="not calibrated yet"):
        write_report(write_study(tmp_path))
