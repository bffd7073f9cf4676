"""The model of a sealed case: what it keeps of its rows does not change its values."""

import numpy as np

from doe.trials.reduced.laboratory import CaseModel

SEEDS = np.array([3, 8])


def value(model: CaseModel, diameter: np.ndarray, strength: float = 1.0) -> np.ndarray:
    return model("threshold_u_star", {"diameter": diameter}, {}, {"gusts": strength}, SEEDS)


def test_rows_that_cannot_change_have_the_values_of_rows_that_can():
    model = CaseModel(1.0, 0.3, {})
    fresh = np.geomspace(1e-4, 1e-3, 6)
    fixed = fresh.copy()
    fixed.setflags(write=False)
    expected = value(model, fresh)
    assert not model.states, "rows that may change are not kept"
    assert np.array_equal(value(model, fixed), expected)
    assert np.array_equal(value(model, fixed), expected), "kept rows"
    assert len(model.states) == 1
    assert not np.array_equal(value(model, fixed, 2.0), expected)
