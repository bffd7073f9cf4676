"""A calibration on a model whose answer is known finds what matters and hits the target."""

import re
from pathlib import Path

import closed_form
import numpy as np
import pytest
import tomli_w
from execution.small_scene import SCENE
from recorded_heaps import read_chunks
from scene_tables import refusal

from taichi_erosion.campaign import calibration_steps, execute
from taichi_erosion.campaign.calibration import calibrate
from taichi_erosion.campaign.calibration_steps import STAGES, refuse_axial_points_outside, surface_design
from taichi_erosion.campaign.study_file import read_calibration_study
from taichi_erosion.cli.doe import print_analysis, print_confirmation, print_path, print_surface
from taichi_erosion.cli.main import ExitCode, main
from taichi_erosion.core.errors import BadInput
from taichi_erosion.execution.checks import read_scene
from taichi_erosion.experiments.design import Factor
from taichi_erosion.report import write_report
from taichi_erosion.report.calibration_page import write_page_and_pictures, write_recording
from tests.report.browser import assert_readable

TARGET = 31.0  # deg
STUDY = {
    "study": {"seed": 5},
    "observables": {"repose_angle": {"scene": "few.toml"}},
    "targets": {"repose_angle": {"value": TARGET, "sd": 0.5, "n": 10, "unit": "deg"}},
    "parameters": {
        "materials.soil.shear_modulus": {"low": 1e6, "high": 2e6, "unit": "Pa"},
        "contact.soil-soil.restitution": {"low": 0.2, "high": 0.6, "label": "restitution of soil"},
        "contact.soil-soil.friction_sliding": {"low": 0.3, "high": 0.7},
        "contact.soil-soil.friction_rolling": {"low": 0.5, "high": 0.9, "most": 1.5},
        "contact.soil-steel.friction_sliding": {"low": 0.15, "high": 0.55, "most": 1.0},
    },
    "design": {"climb_steps": 4, "confirm": 8},
}
RANGE = {"low": 0.2, "high": 0.6, "least": 0.05, "most": 0.95}
WIDE = STUDY["parameters"] | {"contact.soil-soil.restitution": RANGE}
MATTER = {"contact.soil-soil.restitution", "contact.soil-soil.friction_rolling"}
MATTER |= {"contact.soil-steel.friction_sliding"}
HERE = {"overrides": {"workers": 1}, "function": closed_form.FUNCTION}
TOLD: list[tuple[float, str]] = []  # share of the work and words, as the calibration went on
FEW_RUNS = {"surface": "latin_hypercube", "surface_factors": 4, "surface_runs": 14}


def write_study(folder: Path, **sections) -> Path:
    (folder / "few.toml").write_text(tomli_w.dumps(SCENE), encoding="utf-8")
    path = folder / "study.toml"
    path.write_text(tomli_w.dumps(STUDY | sections), encoding="utf-8")
    return path


def true_angle(settings: dict[str, float]) -> float:
    contact = {"soil-soil": {}, "soil-steel": {}}
    for path in MATTER:
        _, pair, name = path.split(".")
        contact[pair][name] = settings[path]
    return closed_form.angle(contact)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    study = write_study(tmp_path_factory.mktemp("calibration"))
    return calibrate(study, progress=lambda *words: TOLD.append(words), **HERE)


def test_every_step_is_printed_with_the_tables_of_the_page(found, capsys):
    for show in (print_analysis, print_path, print_surface, print_confirmation):
        show(found)
    assert re.search(r"repose_angle: .* simulated, .* measured\n(Yes|No|Not)", capsys.readouterr().out)


@pytest.mark.usefixtures("found")
def test_progress_never_falls_from_stage_to_stage():
    shares = [share for share, _ in TOLD]
    assert shares == sorted(shares)
    assert 0.0 < shares[0] < 0.3
    assert 0.8 < shares[-1] <= 1.0
    assert {words.partition(":")[0] for _, words in TOLD} <= set(STAGES)


def test_every_step_finds_what_the_closed_form_hides(found):
    assert set(found.document["analyse"]["kept"]) == MATTER
    path = found.climb
    distances = abs(path.design.responses["repose_angle"] - TARGET)
    assert path.best > 0
    assert distances[path.best] < distances[0] - 1.0
    # the surface rests on 17 runs: its prediction is good to about 2 sd / sqrt(17 / 10) of the noise
    assert true_angle(found.optimum.optima[0].settings) == pytest.approx(TARGET, abs=2.0 * closed_form.NOISE)
    test = found.document["confirm"]["tests"]["repose_angle"]
    assert test["runs"]["n"] == STUDY["design"]["confirm"]
    assert abs(test["difference"]) < 3.0 * closed_form.NOISE


@pytest.mark.parametrize(
    ("entries", "runs", "furthest"),
    [
        ({"surface": "central_composite", "surface_axial": "spherical"}, 8 + 6 + 5, 3**0.5),
        ({"surface": "latin_hypercube", "surface_runs": 24}, 24 + 5, pytest.approx(1.0, abs=2.0 / 24)),
    ],
)
def test_every_design_finds_the_same_optimum(found, tmp_path, monkeypatch, entries, runs, furthest):
    monkeypatch.setattr(calibration_steps, "run_requests", closed_form.execute_here)
    other = calibrate(write_study(tmp_path, design=STUDY["design"] | entries, parameters=WIDE))
    assert len(other.surface.design) == runs
    assert np.abs(other.surface.design.coded).max() == furthest
    assert other.surface.design.factors == found.surface.design.factors
    # settings that meet the target form a face: what agrees is the value, here and at the other's optimum
    assert true_angle(other.optimum.optima[0].settings) == pytest.approx(TARGET, abs=2.0 * closed_form.NOISE)
    there = found.optimum.optima[0].coded[None, :]
    (low, high), (other_low, other_high) = (
        calibration.surface.fits["repose_angle"].mean_interval(there)[0] for calibration in (found, other)
    )
    assert max(low, other_low) < min(high, other_high)


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ((0.05, 0.25), "star point friction = -0.01818 lies below the limit 0"),
        ((0.6, 0.9), "star point friction = 1.002 lies above the limit 1"),
    ],
)
def test_a_star_point_beyond_a_limit_is_refused_with_the_remedy(tmp_path, place, said):
    unit = {"low": 0.0, "high": 1.0}
    parameters = {"friction": {"low": 0.1, "high": 0.9, "least": 0.0, "most": 1.0}, "b": unit, "c": unit}
    ranges = [Factor("friction", *place), Factor("b", 0.4, 0.6), Factor("c", 0.4, 0.6)]
    design = {"surface": "central_composite"}
    study = read_calibration_study(write_study(tmp_path, design=design, parameters=parameters))
    line = refusal(refuse_axial_points_outside, study, surface_design(study, ranges))
    assert line.endswith(f'{said}; set surface_axial = "faced" in [design]')
    faced = write_study(tmp_path, design=design | {"surface_axial": "faced"}, parameters=parameters)
    assert len(surface_design(read_calibration_study(faced), ranges)) == 19


def test_no_two_runs_share_their_noise(found):
    lines = (found.file.folder / "runs.csv").read_text(encoding="utf-8").splitlines()
    seeds = [line.split(",")[2] for line in lines[1:]]
    assert len(set(seeds)) == len(seeds) == found.document["runs"]


def test_a_step_called_again_runs_nothing_and_says_the_same(found, monkeypatch):
    monkeypatch.setattr(execute.pools, "start_pool", None)  # whoever starts workers fails
    again = calibrate(found.file.path, **HERE)
    timing = dict.fromkeys(("wall_s", "cpu_s"))
    assert again.document | timing == found.document | timing


@pytest.fixture(scope="module")
def page(found):
    return write_page_and_pictures(found)


def test_the_page_and_its_report_hold_every_step_and_its_pictures(found, page, tmp_path):
    text = page.read_text(encoding="utf-8")
    for part in ("Screening", "Steepest ascent", "Response surface", "Optimum", "Confirmation"):
        assert f"## {part}" in text
    pictures = re.findall(r"\]\(([^)]+)\)", text)
    assert len(pictures) == 5
    assert all((page.parent / picture).stat().st_size > 1000 for picture in pictures)
    report = write_report(found.file.path, tmp_path / "calibration.html")
    text = report.read_text(encoding="utf-8")
    assert text.count("data:image/png;base64,") == len(pictures)
    assert "<table>" in text
    assert 'src="pictures' not in text
    assert_readable({"calibration": report}, tmp_path)


def test_the_design_alone_runs_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["doe", "design", str(write_study(tmp_path))]) == ExitCode.SUCCESS
    assert "friction_rolling" in capsys.readouterr().out
    assert sorted(path.name for path in (tmp_path / "study").iterdir()) == ["screen.csv", "written.json"]


@pytest.mark.parametrize(
    ("sections", "said"),
    [
        ({"targets": {"pile_height": {"value": 1.0, "sd": 0.1, "n": 3}}}, "targets.pile_height"),
        ({"design": {"surface_axial": "faced"}}, "surface_axial needs surface = 'central_composite'"),
        ({"design": FEW_RUNS}, "surface_runs = 14; a quadratic in 4 factors needs at least 15"),
    ],
)
def test_a_wrong_entry_of_a_study_gives_one_clear_line(tmp_path, sections, said):
    line = refusal(read_calibration_study, write_study(tmp_path, **sections))
    assert said in line
    assert "study.toml" in line


@pytest.mark.parametrize(
    ("sections", "said"),
    [
        ({"parameters": STUDY["parameters"] | {"contact.soil-soil.stickiness": RANGE}}, "stickiness"),
        ({"observables": {"repose_angle": {"scene": "few.toml", "measure": "base_angle"}}}, "not measure"),
    ],
)
def test_what_the_scene_lacks_is_refused_before_anything_runs(tmp_path, sections, said):
    with pytest.raises(BadInput, match=said):
        calibrate(write_study(tmp_path, **sections), **HERE)


def test_the_recording_holds_the_table_of_all_runs(found, page):
    chunks = read_chunks(write_recording(found.file.path))
    (table,) = [chunk.to_record_batch() for chunk in chunks if chunk.entity_path == "/design"]
    columns = dict(zip(table.schema.names, table.columns, strict=True))
    # a viewer takes letters of identifiers
    paths = {re.sub("[.-]", "_", path) for path in STUDY["parameters"]}
    assert {"stage", "row", "seed", "repose_angle", *paths} <= set(columns)
    assert len(columns["repose_angle"][0]) == found.document["runs"]


def test_the_calibrated_scene_runs_with_the_numbers_of_the_confirmation_runs(found):
    (written,) = map(Path, found.document["calibrated_scenes"])
    assert written == found.file.folder / "few_calibrated.toml"
    scene = read_scene(written, ())
    for path, value in found.optimum.optima[0].settings.items():
        _, pair, name = path.split(".")
        assert getattr(scene.contact[pair], name) == pytest.approx(value, rel=1e-5)
    centre = STUDY["parameters"]["materials.soil.shear_modulus"]
    assert scene.materials["soil"].shear_modulus == 0.5 * (centre["low"] + centre["high"])
