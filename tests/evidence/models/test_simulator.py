"""Scenes that answer: what a row, numbers and effects, also the user's own, change in a scene."""

from pathlib import Path

import numpy as np
import pytest

from taichi_erosion.cli.effects import effect_file_text
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.models.load_study import NO_OPTIONS, StudyOptions, load_study
from taichi_erosion.evidence.models.simulator import row_at
from tests.evidence.small_study import write_study

ROOT = Path(__file__).parents[3]
FRICTION = "contact.grain-grain.friction_rolling"
READING = (ROOT / "taichi_erosion" / "effect_library" / "repose_method.py").read_text(encoding="utf-8")
PULL = effect_file_text("pair_effect").replace("NAME", "constant_pull")
ROOTED = PULL.replace('"pull": strength', '"pull": conditions.get("root_density", 0.0) * strength').replace(
    "    constants=",
    '    reads=("root_density",),\n    dose=lambda params, known: known["root_density"],\n    constants=',
)
TABLE = """observable,value,sd,n,unit,group,moisture,angularity,diameter [mm],roots [g/cm3],source
pile_height,9.3,0.3,6,mm,a,0,0,1.5,0,made
pile_height,9.9,0.3,6,mm,b,0.01,0.5,1.5,0.004,made
pile_height,18.4,0.5,6,mm,c,0,0,3,0,made
"""
FILES = 'effect_files = ["glue.py"]\n'
STUDY = f"""
[study]
measurements = "heap.csv"
{FILES}[observables.pile_height]
scene = "heap.toml"
[conditions]
moisture = "conditions.moisture"
angularity = "conditions.angularity"
diameter = "grains.size.diameter"
roots = "conditions.root_density"
[parameters]
"{FRICTION}" = {{ start = 0.12, low = 0.02, high = 0.6 }}
[candidates]
effects = ["liquid_bridge", "rolling_resistance", "dry_adhesion"]
"""


def study(folder: Path, text: str = STUDY, options: StudyOptions = NO_OPTIONS):
    """A study of rooted heaps with an effect file beside it."""
    scene = (ROOT / "scenes" / "column_collapse.toml").read_text(encoding="utf-8")
    declared = '[conditions.extra]\nroot_density = { unit = "mg/cm3", value = 1.0 }\n\n[run]'
    (folder / "heap.toml").write_text(scene.replace("[run]", declared, 1), encoding="utf-8")
    (folder / "heap.csv").write_text(TABLE, encoding="utf-8")
    (folder / "glue.py").write_text(ROOTED, encoding="utf-8")
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return load_study(folder / "study.toml", options)


def overrides(folder: Path, friction: float = 0.12, **effects: float) -> list[tuple[str, ...]]:
    """What the runs of all rows set in the scene."""
    found = study(folder)
    simulator = found.simulator
    columns = found.problem.model.model_conditions(found.problem.measurements.conditions)
    measure = simulator.measures["pile_height"]
    return [simulator.overrides(measure, row_at(columns, k), {FRICTION: friction}, effects) for k in range(3)]


def test_conditions_parameters_and_effects_become_entries_of_the_scene(tmp_path):
    # the table counts in mm; only the second row is angular, and round grains feel no such effect
    plain, angular, large = overrides(tmp_path, friction=0.2, rolling_resistance=1.5)
    assert plain == ("grains.size.diameter=0.0015", f"{FRICTION}=0.2")
    assert set(angular) == {*plain, "conditions.angularity=0.5", "effects.rolling_resistance.strength=1.5"}
    assert large == ("grains.size.diameter=0.003", f"{FRICTION}=0.2")


def test_a_column_sets_a_declared_condition_in_its_unit_and_effects_read_it_in_si(tmp_path):
    found = study(tmp_path)
    column = found.problem.measurements.conditions["roots"]
    assert column == pytest.approx([0.0, 4.0, 0.0])  # g/cm3 in the table, mg/cm3 in the scene
    known = found.simulator.stated_columns({"conditions.root_density": column}, tmp_path / "heap.toml")
    assert known["root_density"] == pytest.approx([0.0, 4.0, 0.0])  # kg m-3
    _, rooted, _ = overrides(tmp_path, constant_pull=1.0)
    assert "conditions.root_density=4.0" in rooted


def test_an_effect_whose_file_is_named_is_a_candidate(tmp_path):
    def names(text: str, *files: Path) -> list[str]:
        found = study(tmp_path, text, StudyOptions(effect_files=files))
        assert ("glue.py" in found.model) == bool(files or FILES in text)
        return [each.name for each in found.problem.candidates][3:]

    assert names(STUDY) == ["constant_pull"]
    assert names(STUDY.replace(FILES, "")) == []
    assert names(STUDY.replace(FILES, ""), tmp_path / "glue.py") == ["constant_pull"]


def test_a_model_function_is_read_through_an_instrument_of_ones_own(tmp_path):
    (tmp_path / "mine.py").write_text(READING, encoding="utf-8")
    options = StudyOptions(effect_files=(tmp_path / "mine.py",))
    problem = load_study(write_study(tmp_path, {}), options).problem
    assert "mine" in [each.name for each in problem.candidates]
    conditions = {"moisture": np.zeros(2), "diameter": np.full(2, 3e-4)}
    numbers = {each.path: each.start for each in problem.parameters}
    bare, half, full = (
        problem.model("repose_angle", conditions, numbers, {"mine": strength}, np.arange(3))
        for strength in (0.0, 0.5, 1.0)
    )
    assert np.all(full != bare)
    assert half - bare == pytest.approx(0.5 * (full - bare))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("observables.pile_height]", "observables.pile_height]\nmeasure = 'flux'", "not flux"),
        ("conditions.angularity", "conditions.colour", "conditions.colour fits no scene of the study"),
        ("friction_rolling", "friction_of_mind", "fits no scene of the study"),
        ("heap.toml", "nowhere.toml", "no such file"),
    ],
)
def test_what_a_scene_cannot_answer_is_told_before_anything_runs(tmp_path, old, new, told):
    assert old in STUDY
    with pytest.raises(BadInput, match=told):
        study(tmp_path, STUDY.replace(old, new))


@pytest.mark.parametrize(
    ("listed", "unread"),
    [('["liquid_bridge", "rolling_resistance"]', []), ('["dry_adhesion"]', ["moisture", "angularity"])],
)
def test_a_column_that_no_candidate_reads_is_told_with_the_effects_that_do(tmp_path, listed, unread):
    text = STUDY.replace('["liquid_bridge", "rolling_resistance", "dry_adhesion"]', listed)
    told = [note for note in study(tmp_path, text).notes if "changes no run" in note]
    assert [note.split()[0] for note in told] == unread
    readers = {"moisture": "liquid_bridge", "angularity": "rolling_resistance"}
    assert all(readers[name] in note for name, note in zip(unread, told, strict=True))
