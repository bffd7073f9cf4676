"""Scenes as a model: what a request changes in a scene, what it shares, and what it does not run at all.

The campaign behind it is replaced by a stand-in that reads the scene it is given; one test simulates.
"""

from pathlib import Path

import numpy as np
import pytest

from taichi_erosion.campaign.request import RunResult
from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.evidence.models import simulator
from taichi_erosion.evidence.models.load_study import load_study

ROOT = Path(__file__).parents[3]
SCENE = ROOT / "scenes" / "column_collapse.toml"
FRICTION = "contact.grain-grain.friction_rolling"
TABLE = """observable,value,sd,n,unit,group,moisture,angularity,diameter [mm],source
pile_height,9.3,0.3,6,mm,a,0,0,1.5,made
pile_height,9.9,0.3,6,mm,b,0.01,0.5,1.5,made
pile_height,18.4,0.5,6,mm,c,0,0,3,made
"""
STUDY = f"""
[study]
measurements = "heap.csv"
[observables.pile_height]
scene = "{SCENE}"
[conditions]
moisture = "conditions.moisture"
angularity = "conditions.angularity"
diameter = "grains.size.diameter"
[parameters."{FRICTION}"]
start = 0.12
low = 0.02
high = 0.6
[candidates]
effects = ["liquid_bridge", "rolling_resistance", "dry_adhesion"]
"""


def heap_in(payload: dict) -> float:
    """Height of a made-up heap [m]: it grows with diameter, friction, and every effect's strength."""
    scene = payload["scene"]
    strengths = sum(entry["strength"] for entry in scene["effects"].values())
    friction = scene["contact"]["grain-grain"]["friction_rolling"]
    return scene["grains"]["size"]["diameter"] * (6.0 + friction + strengths) + 1e-9 * payload["seed"]


def made(wanted) -> list[RunResult]:
    """Results of runs, by `heap_in`."""
    return [
        RunResult(r.key, {"measures": {"pile_height": {"value": heap_in(r.payload), "unit": "m"}}})
        for r in wanted
    ]


@pytest.fixture
def asked(monkeypatch):
    """Requests that reach the campaign."""
    requests = []
    monkeypatch.setattr(
        simulator, "execute", lambda wanted, *_, **__: requests.append(wanted) or made(wanted)
    )
    return requests


def study(tmp_path: Path, text: str = STUDY):
    (tmp_path / "heap.csv").write_text(TABLE, encoding="utf-8")
    (tmp_path / "heap.toml").write_text(text, encoding="utf-8")
    return load_study(tmp_path / "heap.toml")


def ask(tmp_path: Path, seeds=(1, 2), friction: float = 0.12, **effects: float):
    problem = study(tmp_path).problem
    conditions = problem.measurements.conditions
    return problem.model("pile_height", conditions, {FRICTION: friction}, effects, np.array(seeds))


def test_conditions_parameters_and_effects_become_entries_of_the_scene(tmp_path, asked):
    found = ask(tmp_path, friction=0.2, rolling_resistance=1.5)
    # the table counts in mm; only the second row is angular, and round grains feel no such effect
    assert found[0] == pytest.approx([1.5 * 6.2, 1.5 * 7.7, 3.0 * 6.2], rel=1e-5)
    scene = asked[0][2].payload["scene"]
    assert scene["effects"]["rolling_resistance"]["strength"] == 1.5
    assert scene["conditions"]["angularity"] == 0.5
    assert scene["contact"]["grain-grain"]["friction_rolling"] == 0.2


def test_the_bare_model_is_run_once_for_all_conditions_that_nothing_reads(tmp_path, asked):
    ask(tmp_path)
    keys = [request.key for request in asked[0]]
    assert len(keys) == 6
    assert len(set(keys)) == 4, "two diameters, two seeds: moisture and angularity change nothing"


def test_the_mask_of_a_candidate_says_where_it_can_act(tmp_path):
    problem = study(tmp_path).problem
    masks = {c.name: c.mask(problem.measurements.conditions).tolist() for c in problem.candidates if c.mask}
    wet = [False, True, False]
    assert masks == {"liquid_bridge": wet, "rolling_resistance": wet, "dry_adhesion": [True] * 3}


def test_a_failed_run_is_no_value_and_nothing_but_failures_ends_the_study(tmp_path, monkeypatch):
    def failing(first: int):
        words = "grains 3 and 7 overlap"
        return lambda wanted, *_, **__: (
            [RunResult(r.key, failure=words) for r in wanted[:first]] + made(wanted[first:])
        )

    monkeypatch.setattr(simulator, "execute", failing(1))
    assert np.isnan(ask(tmp_path)).sum() == 1
    monkeypatch.setattr(simulator, "execute", failing(6))
    with pytest.raises(SimulationStopped, match="all 6 runs stopped; the first: grains 3 and 7 overlap"):
        ask(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("observables.pile_height]", "observables.pile_height]\nmeasure = 'flux'", "not flux"),
        ("conditions.angularity", "conditions.colour", "conditions.colour fits no scene of the study"),
        ("friction_rolling", "friction_of_mind", "fits no scene of the study"),
        ('"dry_adhesion"', '"moonlight"', "candidates.moonlight is not in the library"),
        (str(SCENE), "nowhere.toml", "no such file"),
    ],
)
def test_what_a_scene_cannot_answer_is_told_before_anything_runs(tmp_path, old, new, told):
    assert old in STUDY
    with pytest.raises(BadInput, match=told):
        study(tmp_path, STUDY.replace(old, new))


def test_a_small_collapse_answers_and_is_not_run_twice(tmp_path):
    small = tmp_path / "small.toml"
    small.write_text(SCENE.read_text("utf-8").replace("count = 1800", "count = 60"), encoding="utf-8")
    problem = study(tmp_path, STUDY.replace(str(SCENE), str(small))).problem
    words = ("pile_height", problem.measurements.conditions, {FRICTION: 0.12}, {}, np.array([1]))
    first = problem.model(*words)
    assert np.all(first > 1.0)
    ledger = tmp_path / "heap-results" / "ledger.sqlite"
    before = ledger.stat().st_mtime_ns
    assert np.array_equal(problem.model(*words), first)
    assert ledger.stat().st_mtime_ns == before
