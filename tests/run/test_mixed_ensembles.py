"""Replicas with different effects in one ensemble: who may run beside whom, and that nobody notices."""

from pathlib import Path

import pytest
from small_scene import write_scene

from taichi_erosion.core.setup import Numerics
from taichi_erosion.run.checks import read_scene
from taichi_erosion.run.ensemble import Part, play_ensemble
from taichi_erosion.run.ensemble_compatibility import shared_choices

WET = (
    "conditions.moisture=0.02",
    "effects.liquid_bridge.strength=1",
    "effects.liquid_bridge.wet_fraction=0.5",
)
TAPPED = ("effects.packing_preparation.strength=1",)
ANGULAR = ("conditions.angularity=0.5", "effects.rolling_resistance.strength=1")
LONG = ("effects.grain_shape.strength=1",)
CHARGED = ("effects.electric_field.strength=1",)


def choices(scene: Path, orders: tuple[str, ...]) -> str:
    return shared_choices(read_scene(scene, orders))


def heights(scene: Path, cases: list[tuple[str, ...]]) -> list[float]:
    found: dict[int, float] = {}
    parts = [Part(read_scene(scene, orders), 5) for orders in cases]
    play_ensemble(
        parts,
        Numerics("cpu", 1, "f32"),
        lambda place, record: found.update({place: record["measures"]["pile_height"]["value"]}),
    )
    return [found[place] for place in range(len(cases))]


def test_pulls_and_changes_of_the_scene_need_no_ensemble_of_their_own(tmp_path):
    scene = write_scene(tmp_path)
    assert len({choices(scene, orders) for orders in ((), WET, TAPPED, ANGULAR)}) == 1


def test_clumps_and_forces_on_single_grains_do(tmp_path):
    scene = write_scene(tmp_path)
    assert len({choices(scene, orders) for orders in ((), LONG, CHARGED)}) == 3


@pytest.mark.slow
def test_replicas_beside_others_with_effects_come_out_bit_for_bit_as_alone(tmp_path):
    scene = write_scene(tmp_path)
    together = heights(scene, [(), WET, TAPPED])
    assert together == [*heights(scene, [()]), *heights(scene, [WET]), together[2]]
    assert len(set(together)) == 3
