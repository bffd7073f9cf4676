"""Last lines of the commands: what the result means, and the command that comes next."""

from pathlib import Path

import pytest

from taichi_erosion.cli import next_steps
from taichi_erosion.cli.main import main
from taichi_erosion.cli.next_steps import (
    after_adoption,
    after_comparison,
    after_discovery,
    after_next,
    after_run,
)

ROOT = Path(__file__).resolve().parents[2]


COMPARED = {"study": "a.toml", "where": [], "observables": {"flux": {"n": 9}}, "parameters": {"a": {}}}


@pytest.fixture(autouse=True)
def launched(monkeypatch):
    monkeypatch.setenv(next_steps.NAME_SWITCH, "erosion")


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


def test_a_comparison_that_fails_leads_to_discover_and_one_that_holds_does_not():
    failing = list(after_comparison(COMPARED | {"p": 1e-6}))
    assert failing[0] == "`./erosion discover a.toml` asks which effect is missing."
    holding = list(after_comparison(COMPARED | {"p": 0.4, "where": [{"p": 0.3}]}))
    assert not any("discover" in line for line in holding)


def test_a_discovery_leads_on_by_its_verdict():
    found = {"study": "a.toml", "verdict": "present", "named": ["x", "y"], "rows_hidden": 5, "clues": []}
    assert next(after_discovery(found)).startswith(
        "`./erosion adopt a.toml x y` adds x and y and tests it on 5 held-out"
    )
    outside = found | {"verdict": "outside_library", "named": [], "clues": [{"law": {}}]}
    assert "--from-discovery a-results/a.discover.json" in next(after_discovery(outside))
    silent = list(after_discovery(found | {"verdict": "none_detected", "named": []}))
    assert not any("adopt" in line for line in silent)
    assert any("next a.toml" in line for line in silent)


def test_the_next_command_names_the_effect_files_again():
    options = [Path("roots.py"), Path("pores.py")]
    found = {"study": "a.toml", "verdict": "present", "named": ["x"], "rows_hidden": 5, "clues": []}
    lines = [
        *after_discovery(found, options),
        *after_discovery(found | {"verdict": "unstable", "named": []}, options),
        *after_comparison(COMPARED | {"p": 1e-6}, options),
        *after_adoption(adoption(40.0, 38.0), options),
        *after_next({"study": "a.toml", "measurements": "a.csv", "next_experiments": [{}]}, options),
    ]
    told = [
        line for line in lines if any(f"/erosion {word}" in line for word in ("adopt", "discover", "next"))
    ]
    assert len(told) == 7
    assert all("a.toml" in line and " --effect roots.py --effect pores.py" in line for line in told)
    assert next(after_discovery(found, options)).startswith(
        "`./erosion adopt a.toml x --effect roots.py --effect pores.py` adds x"
    )


def test_the_next_command_quotes_names_with_spaces():
    told = next(after_comparison(COMPARED | {"study": "my lab/a.toml", "p": 1e-6}, [Path("my pull.py")]))
    assert told.startswith("`./erosion discover 'my lab/a.toml' --effect 'my pull.py'` asks")
    (_, view, report) = after_run(run_document(33.6) | {"recording": Path("my runs/a.rrd")})
    assert "view 'my runs/a.rrd'`" in view
    assert "report 'my runs/a.rrd'`" in report


def adoption(before: float | None, after: float | None, opened: int = 1, height: float = 1.0) -> dict:
    fits = {
        "base": {"vault_chi2_per_row": before, "vault_rmse": {"angle": 4.0, "height": 2.0}},
        "added": {"vault_chi2_per_row": after, "vault_rmse": {"angle": 1.0, "height": height}},
        "vault": {"opened": opened},
    }
    return fits | {"written": "a_with_x.toml", "study": "a.toml"}


def test_an_adoption_says_what_the_held_out_rows_said():
    assert "The error falls" in next(after_adoption(adoption(40.0, 3.0)))
    assert "rises for height (by 15 %)" in next(after_adoption(adoption(40.0, 3.0, height=2.3)))
    assert "opened 2 times" in next(after_adoption(adoption(40.0, 3.0, opened=2)))
    refuted = list(after_adoption(adoption(40.0, 38.0)))
    assert "do not support it" in refuted[0]
    assert not any("a_with_x" in line for line in refuted)
    assert "No held-out row" in next(after_adoption(adoption(None, None)))


def test_a_new_effect_file_leads_to_its_check(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["effects", "new", "crust_glue"]) == 0
    assert (
        "`./erosion effects crust_glue --effect crust_glue.py` shows and checks it."
        in capsys.readouterr().err
    )
