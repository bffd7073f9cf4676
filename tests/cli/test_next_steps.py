"""Last lines of the commands: what the result means, and the command that comes next."""

from pathlib import Path

import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.cli.next_steps import after_run
from taichi_erosion.evidence.words.shell import NAME_SWITCH

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def launched(monkeypatch):
    monkeypatch.setenv(NAME_SWITCH, "erosion")


def run_document(value: float, sd: float = 0.5, name: str = "repose_angle", unit: str = "deg") -> dict:
    return {
        "scene": str(ROOT / "scenes" / "funnel_repose.toml"),
        "measures": {name: {"value": value, "sd": sd, "unit": unit, "n": 3}},
        "measured": {name: {"value": 33.5, "sd": 0.7, "n": 10}},
        "recording": "recordings/a.rrd",
    }


def test_a_heap_far_off_is_told_with_the_studies_of_its_scene(monkeypatch):
    monkeypatch.chdir(ROOT)
    lines = list(after_run(run_document(28.7)))
    assert lines[0] == "The heap is 4.8 deg flatter than measured, far outside both scatters."
    assert "`./erosion doe calibrate doe/funnel_soil.toml` calibrates it." in lines
    assert any("report recordings/a.rrd" in line for line in lines)


def test_a_difference_is_judged_by_scatter_and_by_standard_errors():
    assert "steeper" in next(after_run(run_document(38.5)))
    assert next(after_run(run_document(34.5))).endswith("2.7 standard errors.")
    assert (
        next(after_run(run_document(33.6))) == "The heap agrees with the measured value within its scatter."
    )
    other = next(after_run(run_document(20.0, name="flux", unit="kg/(m s)")))
    assert other == "`flux` is 14 kg/(m s) lower than measured, far outside both scatters."


def test_one_run_has_no_scatter_that_a_difference_could_be_judged_by():
    document = run_document(28.7)
    document["measures"]["repose_angle"]["n"] = 1
    told = next(after_run(document))
    assert "6.9 times the measured scatter; one run shows no scatter" in told
    assert "far outside" not in told


def test_a_command_quotes_names_with_spaces():
    (_, view, report) = after_run(run_document(33.6) | {"recording": Path("my runs/a.rrd")})
    assert "view 'my runs/a.rrd'`" in view
    assert "report 'my runs/a.rrd'`" in report


def test_a_new_effect_file_leads_to_its_check(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["effects", "new", "crust_glue"]) == 0
    assert (
        "`./erosion effects crust_glue --effect crust_glue.py` shows and checks it."
        in capsys.readouterr().err
    )
