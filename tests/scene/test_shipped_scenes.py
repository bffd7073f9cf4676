"""The scenes that come with the program."""

from math import atan, degrees
from pathlib import Path

import numpy as np
import pytest
from scene_tables import SCENES

from taichi_erosion.evidence.words.run_words import run_warnings
from taichi_erosion.run import RunOptions, run_scene
from taichi_erosion.run.checks import check_scene
from taichi_erosion.scene import build_setup, explain, load_scene
from taichi_erosion.scene.load import load_air_scene

TUNNEL = SCENES / "tunnel_section.toml"


def test_the_tunnel_is_the_published_working_section():
    air = load_air_scene(TUNNEL).air
    assert air.extents == (7.2, 0.6, 1.0)  # half of the width of 1.2 m
    assert air.sides["y_high"].kind == "symmetry"


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_a_shipped_scene_loads_builds_and_warns_of_nothing(path: Path):
    assert check_scene(path)["limits"].get("warnings", []) == []


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_a_run_of_a_shipped_scene_prints_no_warning(path: Path):
    assert run_warnings(run_scene(path, RunOptions(no_record=True))) == []


def test_the_funnel_has_the_published_parameters_and_enough_grains():
    scene = load_scene(SCENES / "funnel_repose.toml")
    soil, steel = scene.contact["soil-soil"], scene.contact["soil-steel"]
    assert (soil.restitution, soil.friction_sliding, soil.friction_rolling) == (0.60, 0.61, 0.69)
    assert (steel.restitution, steel.friction_sliding, steel.friction_rolling) == (0.25, 0.34, 0.41)
    assert (scene.materials["soil"].density, scene.materials["steel"].shear_modulus) == (2130.0, 7e10)
    assert scene.grains.count >= 3000
    assert scene.run.replicas >= 3
    told = explain(scene)
    outlet = 2.0 * scene.geometry["funnel"].outlet_radius
    assert outlet > 6.0 * told["diameter"]["high"]
    # grain-steps of all replicas at 25 million a second stay below 90 s
    assert scene.grains.count * scene.run.replicas * told["steps_most"] < 90 * 25e6 * 1.01


@pytest.mark.parametrize(("diameter", "least"), [(1.5e-3, 6.1), (3e-3, 8.6)])
def test_the_column_is_the_apparatus_of_laboratory_c(diameter: float, least: float):
    scene = load_scene(SCENES / "column_collapse.toml", [f"grains.size.diameter={diameter}"])
    settle, collapse = scene.stages
    assert scene.geometry["tube"].radius == pytest.approx(9.0 * diameter)
    assert scene.run.time_step == pytest.approx(1e-2 * diameter)
    assert settle.duration_min == pytest.approx(least * np.sqrt(diameter / 9.81), rel=0.01)
    assert (settle.duration_max, collapse.duration_max) == pytest.approx((350.0 * diameter, 430.0 * diameter))
    assert (settle.rest_energy, collapse.rest_energy) == (1e-5, 1e-7)
    assert collapse.remove == ("tube",)
    assert (scene.grains.count, scene.contact["grain-grain"].friction_rolling) == (1800, 0.12)


def test_the_incline_lets_go_at_the_friction_angle_before_it_tips():
    scene = load_scene(SCENES / "incline.toml")
    friction = scene.contact["soil-steel"].friction_sliding
    assert scene.measured["sliding_angle"].value == pytest.approx(degrees(atan(friction)), abs=0.01)
    assert friction < 1.0 / np.sqrt(3.0)
    grains = build_setup(scene, 1).grains
    assert np.all((grains.position[:, 2] > grains.radius) & (grains.position[:, 2] < 1.02 * grains.radius))
    tilt = scene.stages[1]
    assert tilt.tilt_rate * tilt.duration_max > scene.measured["sliding_angle"].value
