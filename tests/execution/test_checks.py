"""Checks of a scene that need no device."""

import re
from pathlib import Path

import pytest
from small_scene import TAPPED, WET, write_scene

from taichi_erosion.effect_library import load_library
from taichi_erosion.execution import check_scene
from taichi_erosion.execution.checks import comparable, compatibility_key, load_air_scene, read_scene

ANGULAR = ("conditions.angularity=0.5", "effects.rolling_resistance.strength=1")
LONG = ("effects.grain_shape.strength=1",)
CHARGED = ("effects.electric_field.strength=1",)
NO_WIND = "there is no [wind] section"


@pytest.mark.parametrize(("cases", "ensembles"), [(((), WET, TAPPED, ANGULAR), 1), (((), LONG, CHARGED), 3)])
def test_clumps_and_forces_on_single_grains_alone_need_ensembles_of_their_own(tmp_path, cases, ensembles):
    scene = write_scene(tmp_path)
    assert len({compatibility_key(read_scene(scene, orders)) for orders in cases}) == ensembles


IDLE = {
    "liquid_bridge": "conditions.moisture is not stated, conditions.clay_fraction is not stated",
    "bed_slope": "conditions.slope is not stated",
    "drag_partition": f"conditions.roughness_density is not stated, {NO_WIND}",
    "electric_field": f"conditions.moisture is not stated, {NO_WIND}",
    "magnus_lift": NO_WIND,
    "trap_efficiency": "it changes the reading of none of ",
}


def test_a_condition_that_is_possible_and_unusual_is_warned_of(tmp_path: Path):
    report = check_scene(write_scene(tmp_path), (*WET, "conditions.moisture=1.0"))["limits"]
    assert any("conditions.moisture = 1 kg kg-1: usual are" in line for line in report["warnings"])


@pytest.mark.parametrize("name", IDLE)
def test_a_check_tells_what_an_effect_needs_to_act(tmp_path: Path, name: str):
    (line,) = check_scene(write_scene(tmp_path), ((f"effects.{name}.strength=1"),))["limits"]["warnings"]
    assert line.startswith(f"effect '{name}' does not act: {IDLE[name]}")


def test_a_check_is_silent_where_effects_act(tmp_path: Path):
    orders = (*WET, *TAPPED, *ANGULAR, "conditions.slope=5.0", "effects.bed_slope.strength=1")
    assert check_scene(write_scene(tmp_path), orders)["limits"]["warnings"] == []


UNREAD = {  # what is stated, and the effects that a warning names
    "conditions.moisture=0.02": ["liquid_bridge"],  # an electric field needs a wind
    "conditions.angularity=0.5": ["rolling_resistance"],
    "conditions.salinity=0.1": [],
    "conditions.moisture=0.0": None,
}


@pytest.mark.parametrize("order", UNREAD)
def test_a_condition_that_no_effect_reads_is_told_with_those_that_do(tmp_path: Path, order: str):
    found = check_scene(write_scene(tmp_path), (order,))["limits"]["warnings"]
    library = load_library(())
    named = [[name for name in library if re.search(rf"\b{name}\b", line)] for line in found]
    assert named == ([] if UNREAD[order] is None else [UNREAD[order]])


def test_the_remedy_of_an_unread_condition_ends_the_warning(tmp_path: Path):
    path, order = write_scene(tmp_path), "conditions.moisture=0.02"
    (line,) = check_scene(path, (order,))["limits"]["warnings"]
    assert check_scene(path, (order, line.partition("--set ")[2]))["limits"]["warnings"] == []


@pytest.mark.parametrize(
    ("changes", "is_compared"),
    [
        (("grains.count=40", "contact.soil-soil.friction_sliding=0.3", "run.replicas=1"), True),
        (("conditions.moisture=0.01",), True),  # as in the file
        (("grains.size.diameter=1e-3", "run.time_step_fraction=0.1"), False),
        (("conditions.moisture=0.05",), False),
        (("conditions.moisture=0.05", "measured.pile_height.value=0.02"), True),
    ],
)
def test_a_measured_value_is_compared_where_it_was_measured(tmp_path, changes, is_compared):
    path = write_scene(tmp_path, conditions={"moisture": 0.01}, measured={"pile_height": {"value": 0.01}})
    assert bool(comparable(path, read_scene(path, changes))) == is_compared


@pytest.mark.parametrize(("modulus", "is_compared"), [(1e3, True), ("soft", False)])
def test_a_file_that_a_change_repairs_is_compared_where_its_situation_is_stated(
    tmp_path, modulus, is_compared
):
    broken = {"soil": {"density": 2130.0, "shear_modulus": modulus, "poisson_ratio": 0.29}}
    path = write_scene(tmp_path, materials=broken, measured={"pile_height": {"value": 0.01}})
    assert bool(comparable(path, read_scene(path, ("materials.soil.shear_modulus=1e6",)))) == is_compared


SHIPPED = Path(__file__).parents[2] / "scenes"


@pytest.mark.parametrize(
    ("name", "change", "is_compared"),
    [
        ("saltation", "stages.3.friction_velocity=0.5", False),
        ("saltation", "stages.3.duration_max=3.0", True),
        ("wind_threshold", "threshold.speed_ratio=0.048", False),
        ("column_collapse", "geometry.tube.radius_d=10.0", False),
        ("column_collapse", "grains.count=400", True),
        ("channel", "air.driving_gradient=[-4.0, 0.0, 0.0]", False),
        ("channel", "air.cells=[1, 1, 48]", True),
    ],
)
def test_a_measured_value_belongs_to_its_apparatus_and_the_wind_of_its_stages_and_of_its_box(
    name, change, is_compared
):
    path = SHIPPED / f"{name}.toml"
    read = load_air_scene if name == "channel" else read_scene
    assert bool(comparable(path, read(path, (change,)))) == is_compared
