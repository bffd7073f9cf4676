"""Measures by name: what keeps a value from being told."""

from pathlib import Path

import numpy as np
import pytest
from measures.heaps import cone, snapshot_of

from taichi_erosion.core.snapshot import WallPose
from taichi_erosion.execution.checks import read_scene
from taichi_erosion.execution.observables import MeasureInput, measure_observable

SCENES = Path(__file__).parents[2] / "scenes"
SCENE = read_scene(SCENES / "funnel_repose.toml", ())


def test_grains_that_fell_off_a_disc_change_no_value_of_the_heap_and_are_counted():
    heap = cone(30.0, radius=12.0)
    changes = ["geometry.plate.shape=disc", "geometry.plate.radius=0.03"]
    scene = read_scene(SCENES / "funnel_repose.toml", changes)
    all_ = snapshot_of(np.concatenate([(heap[:40] * (9.0, 9.0, 1.0) - (0.0, 0.0, 0.05)), heap]))
    for name, asked in scene.measure.items():
        inputs = (MeasureInput(scene, asked, state, (), ()) for state in (snapshot_of(heap), all_))
        one, both = (measure_observable(name, each) for each in inputs)
        assert (both.value, both.details["fallen_grains"]) == (pytest.approx(one.value, rel=1e-12), 40)
        fell = f"40 of {len(heap) + 40:,} grains fell off the plate; the others are measured"
        assert both.notes == (*one.notes, fell)


@pytest.mark.parametrize(
    ("in_funnel", "waiting", "words"),
    [(0.01, 0.0, ""), (0.3, 0.0, "still in the funnel"), (0.0, 0.2, "not released yet")],
)
def test_a_heap_below_a_funnel_that_has_not_emptied_has_no_value(in_funnel, waiting, words):
    heap = cone(30.0, radius=12.0)
    assert heap[:, 2].max() < SCENE.geometry["funnel"].outlet[2]
    stuck = heap[: int(in_funnel * len(heap))] + np.array([0.0, 0.0, 0.06])
    end = snapshot_of(np.concatenate([heap, stuck]))
    for name, request in SCENE.measure.items():
        state = MeasureInput(SCENE, request, end, (), (), waiting=int(waiting * len(heap)))
        found = measure_observable(name, state)
        assert np.isfinite(found.value) == (not words)
        assert words in "".join(found.notes)


def test_grains_within_a_tube_that_is_lifted_little_are_no_heap():
    scene, heap = read_scene(SCENES / "lifting_cylinder.toml", ()), snapshot_of(cone(30.0, radius=6.0))
    names = [name for name, wall in scene.geometry.items() if wall.shape == "cylinder"]
    for height, valued in ((0.0, True), (1e-3, False)):
        poses = {name: WallPose(True, np.eye(3), np.array([0.0, 0.0, height])) for name in names}
        state = MeasureInput(scene, scene.measure["pile_height"], heap, (), (), poses=poses)
        assert np.isfinite(measure_observable("pile_height", state).value) == valued
