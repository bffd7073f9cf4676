"""Checks of a scene that need no device."""

import subprocess
import sys
from pathlib import Path

import pytest
from small_scene import write_scene

from taichi_erosion.core.errors import BadInput
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


WET = (
    "conditions.moisture=0.02",
    "effects.liquid_bridge.strength=1",
    "effects.liquid_bridge.wet_fraction=0.5",
)
TAPPED = ("effects.packing_preparation.strength=1",)
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


@pytest.mark.parametrize(
    ("order", "told"),
    [
        ("effects.dry_adhesion.beta=7", r"effects\.dry_adhesion\.beta = 7 N m-1 lies outside \[0, 0\.1\]"),
        (
            "effects.dry_adhesion.strength=101",
            r"effects\.dry_adhesion\.strength = 101\.0 lies outside \[0, 100",
        ),
        ("effects.dry_adhesion.bta=1", r"effects\.dry_adhesion\.bta is unknown; did you mean beta\?"),
    ],
)
def test_entries_of_effects_out_of_range_are_refused_when_a_scene_is_read(tmp_path, order, told):
    with pytest.raises(BadInput, match=told):
        read_scene(write_scene(tmp_path), (order,))


def test_a_strength_beyond_the_literature_is_a_warning(tmp_path):
    scene = write_scene(tmp_path)
    for strength, count in ((3, 0), (4, 1)):
        warnings = check_scene(scene, (f"effects.dry_adhesion.strength={strength}",))["limits"]["warnings"]
        assert sum("is more than 3, the largest that its literature supports" in w for w in warnings) == count
