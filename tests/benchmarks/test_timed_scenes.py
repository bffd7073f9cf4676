"""The threshold that the benchmark times is the one that the scene asks for."""

from pathlib import Path

import pytest

from taichi_erosion.benchmark.threshold import BED
from taichi_erosion.scene import load_scene, parse_scene

SCENE = Path(__file__).parents[2] / "scenes" / "wind_threshold.toml"
SECTIONS = ("grains", "materials", "laws", "contact", "geometry", "wind", "fill", "threshold", "stages")


@pytest.mark.parametrize("section", SECTIONS)
def test_the_beds_of_the_benchmark_are_those_of_the_scene(section):
    assert getattr(parse_scene(BED), section) == getattr(load_scene(SCENE), section)
