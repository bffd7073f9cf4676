"""The timed scenes are those of `scenes/`, with what the timing changes in them and nothing else."""

from pathlib import Path

from benchmarks.wind_cases import SCENES, STEP_FRACTION, WINDS, threshold_scene
from taichi_erosion.scene import load_scene
from taichi_erosion.scene.load import INSTALLED

ROOT = Path(__file__).parents[2]
SECTIONS = ("grains", "materials", "laws", "contact", "geometry", "wind", "fill", "threshold", "stages")


def test_scenes_are_read_from_the_source_tree_where_there_is_one():
    assert SCENES == ROOT / "scenes"
    assert INSTALLED == ROOT / "taichi_erosion" / "scene" / "shipped"  # as in pyproject.toml


def test_the_threshold_is_timed_over_the_beds_of_its_scene_under_drag_alone_in_steps_of_all_speeds():
    timed, scene = threshold_scene(), load_scene(SCENES / "wind_threshold.toml")
    assert [name for name in SECTIONS if getattr(timed, name) != getattr(scene, name)] == []
    assert (timed.effects, timed.run.time_step_fraction) == ({}, STEP_FRACTION)


def test_the_patch_is_timed_in_the_wind_of_the_scene():
    stages = load_scene(SCENES / "saltation.toml").stages
    assert [stages[1].friction_velocity, stages[-1].friction_velocity] == [wind for wind, _ in WINDS]
