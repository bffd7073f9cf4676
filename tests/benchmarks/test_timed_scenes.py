"""What the benchmark times is what the scenes ask for."""

from pathlib import Path

import pytest

from taichi_erosion.benchmark.air import TUNNEL
from taichi_erosion.benchmark.patch import PATCH
from taichi_erosion.benchmark.threshold import BED
from taichi_erosion.scene import load_scene, parse_scene
from taichi_erosion.scene.load import load_air_scene, parse_air_scene

SCENES = Path(__file__).parents[2] / "scenes"
SAND = ("grains", "materials", "laws", "contact", "geometry", "wind", "fill")


@pytest.mark.parametrize("section", [*SAND, "threshold", "stages"])
def test_the_beds_of_the_benchmark_are_those_of_the_scene(section):
    assert getattr(parse_scene(BED), section) == getattr(load_scene(SCENES / "wind_threshold.toml"), section)


@pytest.mark.parametrize("section", SAND)
def test_the_patch_of_the_benchmark_is_that_of_the_scene(section):
    assert getattr(parse_scene(PATCH), section) == getattr(load_scene(SCENES / "saltation.toml"), section)


def test_the_tunnel_of_the_benchmark_is_that_of_the_scene():
    scene = load_air_scene(SCENES / "tunnel_section.toml")
    assert parse_air_scene(TUNNEL).air == scene.air
    assert parse_air_scene(TUNNEL).run == scene.run
