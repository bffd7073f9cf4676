"""The scenes that come with the program."""

from math import atan, degrees
from pathlib import Path

import pytest
from scene_tables import SCENES

from taichi_erosion.evidence.words.run_words import run_warnings
from taichi_erosion.run import RunOptions, run_scene
from taichi_erosion.run.checks import check_scene
from taichi_erosion.scene import load_scene


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_a_shipped_scene_loads_builds_and_warns_of_nothing(path: Path):
    assert check_scene(path)["limits"].get("warnings", []) == []


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_a_run_of_a_shipped_scene_prints_no_warning(path: Path):
    assert run_warnings(run_scene(path, RunOptions(no_record=True))) == []


def test_the_incline_lets_go_at_the_friction_angle():
    scene = load_scene(SCENES / "incline.toml")
    friction = scene.contact["soil-steel"].friction_sliding
    assert scene.measured["sliding_angle"].value == pytest.approx(degrees(atan(friction)), abs=0.01)
