"""Measures by name: what keeps a value from being told."""

from pathlib import Path

import numpy as np
import pytest
from measures.heaps import cone, snapshot_of

from taichi_erosion.run.checks import read_scene
from taichi_erosion.run.observables import MeasureInput, measure

SCENE = read_scene(Path(__file__).parents[2] / "scenes/funnel_repose.toml", ())


@pytest.mark.parametrize(("in_funnel", "valued"), [(0.01, True), (0.3, False)])
def test_a_heap_below_a_funnel_that_has_not_emptied_has_no_value(in_funnel: float, valued: bool):
    heap = cone(30.0, radius=12.0)
    assert heap[:, 2].max() < SCENE.geometry["funnel"].outlet[2]
    stuck = heap[: int(in_funnel * len(heap))] + np.array([0.0, 0.0, 0.06])
    end = snapshot_of(np.concatenate([heap, stuck]))
    for name, request in SCENE.measure.items():
        found = measure(name, MeasureInput(SCENE, request, end, (), ()))
        assert np.isfinite(found.value) == valued
        assert valued or "still in the funnel" in found.notes[0]
