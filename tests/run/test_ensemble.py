"""Replicas with different effects in one ensemble."""

from pathlib import Path

import pytest
from small_scene import TAPPED, WET, write_scene

from taichi_erosion.core.setup import Numerics
from taichi_erosion.run.checks import read_scene
from taichi_erosion.run.ensemble import ReplicaRequest, run_replicas


def heights(scene: Path, cases: list[tuple[str, ...]]) -> list[float]:
    found: dict[int, float] = {}
    requests = [ReplicaRequest(read_scene(scene, orders), 5) for orders in cases]
    run_replicas(
        requests,
        Numerics("cpu", 1, "f32"),
        lambda place, record: found.update({place: record["measures"]["pile_height"]["value"]}),
    )
    return [found[place] for place in range(len(cases))]


@pytest.mark.slow
def test_replicas_beside_others_with_effects_come_out_bit_for_bit_as_alone(tmp_path):
    scene = write_scene(tmp_path)
    together = heights(scene, [(), WET, TAPPED])
    assert together == [*heights(scene, [()]), *heights(scene, [WET]), together[2]]
    assert len(set(together)) == 3
