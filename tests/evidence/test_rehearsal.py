"""The loop on scenes, the campaign behind it replaced by a stand-in: rounds of runs, shared and never made twice."""

import json
from math import tanh
from pathlib import Path

import numpy as np
import pytest

from taichi_erosion.campaign.request import RunResult
from taichi_erosion.cli.main import main
from taichi_erosion.evidence import rehearsal

ROOT = Path(__file__).parents[2]
FRICTION = "contact.grain-grain.friction_rolling"
ANGULARITIES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
DIAMETERS = (1.5, 3.0)  # mm
SCATTER = 0.01  # of one run and of one laboratory repeat, relative
STUDY = f"""
[study]
measurements = "heap.csv"
[observables.pile_height]
scene = "{ROOT}/scenes/column_collapse.toml"
transform = "log"
[observables.centroid_height]
scene = "{ROOT}/scenes/column_collapse.toml"
transform = "log"
[conditions]
angularity = "conditions.angularity"
diameter = "grains.size.diameter"
[parameters."{FRICTION}"]
start = 0.15
low = 0.02
high = 0.6
[candidates]
effects = ["rolling_resistance", "dry_adhesion", "restitution_speed"]
"""


def heights(diameter: float, friction: float, rolling: float, sticking: float) -> tuple[float, float]:
    """Heights of pile and centroid [m] in a made-up world."""
    pull = sticking * (1.5e-3 / diameter) ** 2
    steep = tanh(2.0 * (friction + rolling)) + 0.3 * pull
    return diameter * (5.0 + 4.0 * steep), diameter * (1.4 + 1.0 * steep + 0.1 * pull)


def simulated(payload: dict) -> tuple[float, float]:
    """What a run would measure, with its seed's scatter."""
    scene = payload["scene"]
    effects = {name: entry["strength"] for name, entry in scene["effects"].items()}
    rolling = 0.28 * effects.get("rolling_resistance", 0.0) * scene["conditions"]["angularity"]
    friction = scene["contact"]["grain-grain"]["friction_rolling"]
    pair = heights(scene["grains"]["size"]["diameter"], friction, rolling, effects.get("dry_adhesion", 0.0))
    noise = np.random.default_rng(payload["seed"]).normal(0.0, SCATTER, 2)
    return pair[0] * np.exp(noise[0]), pair[1] * np.exp(noise[1])


@pytest.fixture
def asked(monkeypatch):
    """Keys of the runs that reach the campaign, batch by batch."""
    batches = []

    def execute(wanted, store, progress=None):
        batches.append([request.key for request in wanted])
        results = []
        for request in wanted:
            pile, centroid = simulated(request.payload)
            values = {"pile_height": pile, "centroid_height": centroid}
            measures = {name: {"value": value, "unit": "m"} for name, value in values.items()}
            results.append(RunResult(request.key, {"measures": measures}))
        return results

    monkeypatch.setattr(rehearsal, "execute", execute)
    return batches


def write(folder: Path, strength: float, name: str = "heap.toml", text: str = STUDY, seed: int = 1) -> Path:
    """Study and table of a laboratory in whose world angular grains roll badly."""
    generator = np.random.default_rng(seed)
    lines = ["observable,value,n,unit,group,angularity,diameter [mm],source"]
    for a in ANGULARITIES:
        for d in DIAMETERS:
            pair = heights(1e-3 * d, 0.2, 0.28 * strength * a, 0.0)
            for observable, exact in zip(("pile_height", "centroid_height"), pair, strict=True):
                lines += [
                    f"{observable},{exact * generator.normal(1.0, SCATTER):.6g},1,m,a{a:g},{a:g},{d:g},made"
                    for _ in range(3)
                ]
    (folder / "heap.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def ask(capsys, *words: str) -> dict:
    capsys.readouterr()
    assert main([*words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_loop_names_what_acts_and_the_held_out_error_falls(tmp_path, capsys, asked):
    path = write(tmp_path, strength=1.5)
    assert ask(capsys, "compare", str(path))["p"] < 1e-3
    found = ask(capsys, "discover", str(path), "--budget", "quick")
    assert (found["verdict"], found["named"]) == ("present", ["rolling_resistance"])
    assert found["runs"] < 120
    adopted = ask(capsys, "adopt", str(path), "rolling_resistance")
    assert adopted["vault"]["chi2_after"] < 0.5 * adopted["vault"]["chi2_before"]
    fitted = adopted["added"]["strengths"]["rolling_resistance"]
    # the 90 % interval misses one time in ten, three times its half-width once in a million
    assert abs(fitted["value"] - 1.5) < 1.5 * (fitted["high"] - fitted["low"])


def test_a_null_stays_a_null(tmp_path, capsys, asked):
    path = write(tmp_path, strength=0.0)
    found = ask(capsys, "discover", str(path), "--budget", "quick")
    assert found["verdict"] in ("none_detected", "not_testable")
    assert found["named"] == []


def test_a_command_given_again_asks_for_the_same_runs_and_says_the_same(tmp_path, capsys, asked):
    path = write(tmp_path, strength=1.5)
    first = ask(capsys, "discover", str(path), "--budget", "quick")
    made = {key for batch in asked for key in batch}
    asked.clear()
    again = ask(capsys, "discover", str(path), "--budget", "quick")
    assert {key for batch in asked for key in batch} == made
    assert again["probabilities"] == first["probabilities"]


def test_the_first_runs_follow_from_the_study_and_not_from_what_was_measured(tmp_path, capsys, asked):
    ask(capsys, "discover", str(write(tmp_path, 1.5)), "--budget", "quick")
    hidden = asked[0]
    asked.clear()
    ask(capsys, "discover", str(write(tmp_path, 0.0, "other.toml")), "--budget", "quick")
    assert asked[0] == hidden


def test_the_study_that_adopt_writes_goes_on_from_the_same_runs(tmp_path, capsys, asked):
    path = write(tmp_path, strength=1.5)
    ask(capsys, "discover", str(path), "--budget", "quick")
    first = set(asked[0])
    ask(capsys, "adopt", str(path), "rolling_resistance")
    asked.clear()
    compared = ask(capsys, "compare", str(tmp_path / "heap_with_rolling_resistance.toml"))
    assert set(asked[0]) <= first, "bare runs and those of the adopted effect are there"
    assert compared["p"] > 0.01


def test_a_small_budget_is_kept(tmp_path, capsys, asked):
    path = write(tmp_path, 1.5, text=STUDY + "[budget]\nruns = 2\n")
    ask(capsys, "compare", str(path))
    assert len(asked[0]) <= 2 * len(ANGULARITIES) * len(DIAMETERS)


def test_an_effect_that_a_scene_refuses_is_told_and_the_others_are_tried(tmp_path, capsys, asked):
    text = STUDY.replace('"restitution_speed"', '"restitution_speed", "surface_crust"')
    found = ask(capsys, "discover", str(write(tmp_path, 1.5, text=text)), "--budget", "quick")
    assert found["named"] == ["rolling_resistance"]
    assert found["effects"]["surface_crust"]["status"] != "present"
