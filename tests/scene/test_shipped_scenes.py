"""The scenes that come with the program."""

from math import atan, degrees
from pathlib import Path

import pytest
from scene_tables import SCENES

from taichi_erosion.evidence.words.run_words import run_warnings
from taichi_erosion.execution import RunOptions, run_scene
from taichi_erosion.execution.checks import check_scene
from taichi_erosion.scene import load_scene

# conditions of a laboratory that a scene keeps for studies, and that none of its effects reads
UNREAD = {"funnel_repose": ["conditions.moisture", "conditions.altitude"]}
SHORT = [path for path in sorted(SCENES.glob("*.toml")) if path.stem != "million_grains"]  # of minutes


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_a_shipped_scene_loads_builds_and_warns_of_unread_conditions_alone(path: Path):
    warnings = check_scene(path)["limits"].get("warnings", [])
    assert [line.partition(" = ")[0] for line in warnings] == UNREAD.get(path.stem, [])


@pytest.mark.slow
@pytest.mark.parametrize("path", SHORT, ids=lambda path: path.stem)
def test_a_run_of_a_shipped_scene_prints_no_other_warning(path: Path):
    warnings = run_warnings(run_scene(path, RunOptions(no_record=True)))
    kept = [line.partition(" = ")[0] for line in warnings if "fell off the plate" not in line]
    assert kept == UNREAD.get(path.stem, [])


def test_the_incline_lets_go_at_the_friction_angle():
    scene = load_scene(SCENES / "incline.toml")
    friction = scene.contact["soil-steel"].friction_sliding
    assert scene.measured["sliding_angle"].value == pytest.approx(degrees(atan(friction)), abs=0.01)
