"""Scenes that answer: what a row, calibrated numbers and effects change in a scene, and what they share."""

from pathlib import Path

import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.models.load_study import load_study
from taichi_erosion.evidence.models.simulator import row_at

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


def study(tmp_path: Path, text: str = STUDY):
    (tmp_path / "heap.csv").write_text(TABLE, encoding="utf-8")
    (tmp_path / "heap.toml").write_text(text, encoding="utf-8")
    return load_study(tmp_path / "heap.toml")


def overrides(tmp_path: Path, friction: float = 0.12, **effects: float) -> list[tuple[str, ...]]:
    """What the runs of all rows set in the scene."""
    found = study(tmp_path)
    simulator, columns = found.simulator, found.problem.model.known(found.problem.measurements.conditions)
    measure = simulator.measures["pile_height"]
    return [simulator.overrides(measure, row_at(columns, k), {FRICTION: friction}, effects) for k in range(3)]


def test_conditions_parameters_and_effects_become_entries_of_the_scene(tmp_path):
    # the table counts in mm; only the second row is angular, and round grains feel no such effect
    plain, angular, large = overrides(tmp_path, friction=0.2, rolling_resistance=1.5)
    assert plain == ("grains.size.diameter=0.0015", f"{FRICTION}=0.2")
    rolling = "effects.rolling_resistance.strength=1.5"
    assert set(angular) == {*plain, "conditions.angularity=0.5", rolling}
    assert large == ("grains.size.diameter=0.003", f"{FRICTION}=0.2")


def test_the_mask_of_a_candidate_says_where_it_can_act(tmp_path):
    problem = study(tmp_path).problem
    masks = {c.name: c.mask(problem.measurements.conditions).tolist() for c in problem.candidates if c.mask}
    wet = [False, True, False]
    assert masks == {"liquid_bridge": wet, "rolling_resistance": wet, "dry_adhesion": [True] * 3}


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("observables.pile_height]", "observables.pile_height]\nmeasure = 'flux'", "not flux"),
        ("conditions.angularity", "conditions.colour", "conditions.colour fits no scene of the study"),
        ("friction_rolling", "friction_of_mind", "fits no scene of the study"),
        (str(SCENE), "nowhere.toml", "no such file"),
    ],
)
def test_what_a_scene_cannot_answer_is_told_before_anything_runs(tmp_path, old, new, told):
    assert old in STUDY
    with pytest.raises(BadInput, match=told):
        study(tmp_path, STUDY.replace(old, new))
