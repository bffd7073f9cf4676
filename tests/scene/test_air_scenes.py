"""Scenes of air alone: the shipped ones are sound, and bad ones get one clear line."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.run.checks import AIR_OBSERVABLES
from taichi_erosion.scene.build.air import build_air, inlet_speed, longest_step
from taichi_erosion.scene.load import is_air_scene, load_air_scene, parse_air_scene, scene_hash
from taichi_erosion.scene.schema.air import LogProfile, PowerProfile, TableProfile

SCENES = Path(__file__).parents[2] / "scenes"
TUNNEL = SCENES / "tunnel_section.toml"


@pytest.mark.parametrize("name", ["lid_cavity", "channel", "tunnel_section"])
def test_a_shipped_air_scene_loads_and_builds(name: str):
    path = SCENES / f"{name}.toml"
    assert is_air_scene(path)
    scene = load_air_scene(path, observables=AIR_OBSERVABLES)
    setup = build_air(scene, scene.run.seed)
    assert len(setup.faces_z) == setup.cells[2] + 1
    assert setup.time_step <= longest_step(scene)


def test_the_tunnel_is_the_published_working_section():
    air = load_air_scene(TUNNEL).air
    assert air.extents == (7.2, 0.6, 1.0)  # half of the width of 1.2 m
    assert air.sides["y_high"].kind == "symmetry"


def table() -> dict[str, Any]:
    return tomllib.loads(TUNNEL.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("order", "line"),
    [
        ("air.sides.x_high.kind=wall", "an inlet needs an outlet"),
        ("run.time_step=0.1", "CFL"),
        ("air.sides.z_high.kind=inlet", "may stand at x_low or z_low only"),
        ("air.sides.y_low.kind=periodic", "both are periodic or none"),
        ("air.sides.z_high.kind=stress", "air.friction_velocity = 0.0"),
        ("air.viscosity=-1.0", r"air.viscosity = -1.0 lies outside"),
        ("air.inlet.law=steady", "air.inlet.law = 'steady' is not one of"),
        ("air.speed=3.0", "air.speed is unknown"),
        ("air.lowest=0.1", "are higher than the box"),
        ("air.sides.z_low.roughness_length=0.01", "exceeds half a cell"),
        ("air.cells=[100000, 1000, 40]", "at most"),
        ("measure.speed.place=1.0", "measure.speed is unknown"),
    ],
)
def test_a_bad_air_scene_gets_one_line(order: str, line: str):
    with pytest.raises(BadInput, match=line) as refusal:
        parse_air_scene(table(), "tunnel.toml", [order], AIR_OBSERVABLES)
    assert str(refusal.value).startswith("tunnel.toml: ")
    assert "\n" not in str(refusal.value)


def test_a_side_that_is_left_out_is_named():
    raw = table()
    del raw["air"]["sides"]["y_low"]
    with pytest.raises(BadInput, match=r"air\.sides\.y_low is missing"):
        parse_air_scene(raw)


def test_the_hash_follows_the_flow_and_not_its_title():
    plain, titled = parse_air_scene(table()), parse_air_scene(table(), overrides=["scene.title='other'"])
    faster = parse_air_scene(table(), overrides=["air.inlet.speed=7.0"])
    assert scene_hash(plain) == scene_hash(titled) != scene_hash(faster)


def test_inlet_profiles_follow_their_laws():
    height = np.array([0.001, 0.01, 0.2])
    logarithmic = LogProfile(law="log", friction_velocity=0.3, roughness_length=1e-4)
    assert inlet_speed(logarithmic, height, 0.4) == pytest.approx(0.75 * np.log1p(height / 1e-4))
    power = PowerProfile(law="power", speed=6.0, thickness=0.1)
    assert inlet_speed(power, height, 0.4) == pytest.approx(
        [6.0 * 0.01 ** (1 / 7), 6.0 * 0.1 ** (1 / 7), 6.0]
    )
    listed = TableProfile(law="table", heights=(0.0, 0.02), speeds=(0.0, 4.0))
    assert inlet_speed(listed, height, 0.4) == pytest.approx([0.2, 2.0, 4.0])
