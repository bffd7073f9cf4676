"""Effects of the user's own in studies: candidates of scenes, and readings of model functions."""

from pathlib import Path

import numpy as np
import pytest
from small_study import write_study

from taichi_erosion.campaign.request import request_of
from taichi_erosion.cli.new_effect import rendered
from taichi_erosion.evidence.models.load_study import StudyOptions, load_study
from taichi_erosion.evidence.models.simulator import Simulator

ROOT = Path(__file__).parents[3]
PULL = rendered("pair_effect").replace("NAME", "constant_pull")
READING = (ROOT / "taichi_erosion" / "effects" / "repose_method.py").read_text(encoding="utf-8")
TABLE = """observable,value,sd,n,unit,group,roots [g/cm3],source
pile_height,9.3,0.3,6,mm,a,0,made
pile_height,9.9,0.3,6,mm,b,0.004,made
"""
STUDY = """
[study]
measurements = "heap.csv"
effect_files = ["glue.py"]
[observables.pile_height]
scene = "heap.toml"
[conditions]
roots = "conditions.root_density"
[parameters."contact.grain-grain.friction_rolling"]
start = 0.12
low = 0.02
high = 0.6
[candidates]
effects = ["dry_adhesion"]
"""
ROOTED = PULL.replace('"pull": strength', '"pull": conditions.get("root_density", 0.0) * strength').replace(
    "    constants=",
    '    reads=("root_density",),\n    dose=lambda params, known: known["root_density"],\n    constants=',
)


@pytest.fixture
def heap(tmp_path) -> Path:
    """A study of rooted heaps with an effect file beside it."""
    scene = (ROOT / "scenes" / "column_collapse.toml").read_text(encoding="utf-8")
    declared = '[conditions.extra]\nroot_density = { unit = "mg/cm3", value = 1.0 }\n\n[run]'
    (tmp_path / "heap.toml").write_text(scene.replace("[run]", declared, 1), encoding="utf-8")
    (tmp_path / "heap.csv").write_text(TABLE, encoding="utf-8")
    (tmp_path / "glue.py").write_text(ROOTED, encoding="utf-8")
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    return tmp_path / "study.toml"


def simulator_of(path: Path) -> Simulator:
    found = load_study(path).simulator
    assert found is not None
    return found


def test_an_effect_whose_file_is_named_is_a_candidate(heap):
    assert [each.name for each in load_study(heap).problem.candidates] == ["dry_adhesion", "constant_pull"]
    heap.write_text(STUDY.replace('effect_files = ["glue.py"]\n', ""), encoding="utf-8")
    assert [each.name for each in load_study(heap).problem.candidates] == ["dry_adhesion"]
    named = load_study(heap, StudyOptions(effect_files=(heap.parent / "glue.py",)))
    assert [each.name for each in named.problem.candidates] == ["dry_adhesion", "constant_pull"]
    assert "glue.py" in named.model


def test_an_edited_file_makes_new_runs_of_its_effect_alone(heap):
    def keys() -> list[str]:
        simulator = simulator_of(heap)
        orders = ((), ("effects.constant_pull.strength=1.0",))
        return [request_of(simulator.scene(heap.parent / "heap.toml", each), 1).key for each in orders]

    bare, pulled = keys()
    (heap.parent / "glue.py").write_text(ROOTED + "\n", encoding="utf-8")
    again, changed = keys()
    assert again == bare
    assert changed != pulled


def test_a_column_sets_a_declared_condition_in_its_unit_and_effects_read_it_in_si(heap):
    study, simulator = load_study(heap), simulator_of(heap)
    column = study.problem.measurements.conditions["roots"]
    assert column == pytest.approx([0.0, 4.0])  # g/cm3 in the table, mg/cm3 in the scene
    scene = heap.parent / "heap.toml"
    known = simulator.known_conditions({"conditions.root_density": column}, scene)
    assert known["root_density"] == pytest.approx([0.0, 4.0])  # kg m-3
    measure = simulator.measures["pile_height"]
    at = {"conditions.root_density": 4.0}
    assert simulator.overrides(measure, at, {}, {}) == (), "nothing in the bare model reads roots"
    assert "conditions.root_density=4.0" in simulator.overrides(measure, at, {}, {"constant_pull": 1.0})


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
