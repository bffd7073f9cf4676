"""Lengths and times in grain diameters."""

import pytest
from scene_tables import changed, complaint, good_table

from taichi_erosion.scene import parse_scene


def test_an_apparatus_in_diameters_grows_with_its_grains():
    table = changed("geometry.plate", {"shape": "disc", "material": "steel", "radius_d": 40.0})
    table["run"] |= {"time_step_d": 2e-3}
    sizes = ["grains.size.low=2e-3", "grains.size.median=3e-3", "grains.size.high=4e-3"]
    scene = parse_scene(table, overrides=sizes)
    assert scene.geometry["plate"].radius == pytest.approx(0.12)
    assert scene.run.time_step == pytest.approx(6e-6)


def test_a_length_in_diameters_is_told_as_the_user_wrote_it():
    table = good_table()
    table["geometry"]["plate"] = {"shape": "disc", "material": "steel", "radius_d": -9.0}
    # the median of the good scene is 2 mm
    assert "geometry.plate.radius_d = -9.0 diameters: -0.018" in complaint(table)
    # without a diameter only the grains are judged
    table = changed("grains.size.median", "2 mm")
    table["run"] = {"time_step_d": 1e-2}
    assert complaint(table) == "scenes/bad.toml: grains.size.median = '2 mm' must be a number"
