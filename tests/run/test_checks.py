"""Checks of a scene that need no device."""

import subprocess
import sys
from pathlib import Path

import pytest
from small_scene import TAPPED, WET, write_scene

from taichi_erosion.run.checks import check_scene, compatibility_key, read_scene


def test_validation_alone_does_not_load_the_device(tmp_path):
    scene = write_scene(tmp_path)
    words = ["run", str(scene), "--check"]
    code = (
        "import sys; from taichi_erosion.cli.main import main; "
        f"code = main({words!r}); sys.exit(99 if 'taichi' in sys.modules else code)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert "valid" in ended.stdout


ANGULAR = ("conditions.angularity=0.5", "effects.rolling_resistance.strength=1")
LONG = ("effects.grain_shape.strength=1",)
CHARGED = ("effects.electric_field.strength=1",)


def key_of(scene: Path, orders: tuple[str, ...]) -> str:
    return compatibility_key(read_scene(scene, orders))


def test_pulls_and_changes_of_the_scene_need_no_ensemble_of_their_own(tmp_path):
    scene = write_scene(tmp_path)
    assert len({key_of(scene, orders) for orders in ((), WET, TAPPED, ANGULAR)}) == 1


def test_clumps_and_forces_on_single_grains_do(tmp_path):
    scene = write_scene(tmp_path)
    assert len({key_of(scene, orders) for orders in ((), LONG, CHARGED)}) == 3


NO_WIND = "there is no [wind] section"
IDLE = {
    "liquid_bridge": "conditions.moisture is not stated, conditions.clay_fraction is not stated",
    "bed_slope": "conditions.slope is not stated",
    "drag_partition": f"conditions.roughness_density is not stated, {NO_WIND}",
    "electric_field": f"conditions.moisture is not stated, {NO_WIND}",
    "magnus_lift": NO_WIND,
    "trap_efficiency": "it changes the reading of none of ",
}


@pytest.mark.parametrize("name", IDLE)
def test_a_check_tells_what_an_effect_needs_to_act(tmp_path: Path, name: str):
    order = f"effects.{name}.strength=1"
    (line,) = check_scene(write_scene(tmp_path), (order,))["limits"]["warnings"]
    assert line.startswith(f"effect '{name}' does not act: {IDLE[name]}")


def test_a_check_is_silent_where_effects_act(tmp_path: Path):
    orders = (*WET, *TAPPED, *ANGULAR, "conditions.slope=5.0", "effects.bed_slope.strength=1")
    assert check_scene(write_scene(tmp_path), orders)["limits"]["warnings"] == []
