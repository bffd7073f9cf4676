"""Checks of a scene that need no device."""

import subprocess
import sys
from pathlib import Path

from small_scene import TAPPED, WET, write_scene

from taichi_erosion.run.checks import compatibility_key, read_scene


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
