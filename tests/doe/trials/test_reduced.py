"""Laboratories of sealed cases: every disturbance is there, with its size, and no other; kept rows."""

from dataclasses import replace

import numpy as np
import pytest

from doe.trials.reduced.disturbed import DisturbedTruth, measured, true_mean
from doe.trials.reduced.laboratory import NOISE, CaseModel
from taichi_erosion.evidence.data.problem import Floats, Measurements

PLAIN = DisturbedTruth("null", {}, {"friction_sliding": 0.5, "friction_rolling": 0.1}, 1.0, False, "")


def tables(disturbance: str, size: float, count: int) -> list[tuple[Measurements, Floats]]:
    """Tables of the angle of repose under a disturbance, with the errors of their rows in stated sd."""
    understated = size if disturbance == "understated" else 1.0
    truth = replace(PLAIN, disturbance=disturbance, size=size, understated=understated)
    found = []
    for seed in range(count):
        table = measured(np.random.default_rng(seed), truth, ("repose_angle",), ("diameter", "moisture"), 1.0)
        mean = true_mean(truth, "repose_angle", table.conditions)
        found.append((table, (table.value - mean) / NOISE["repose_angle"]))
    return found


@pytest.mark.parametrize(
    ("disturbance", "size", "expected", "within"),
    [
        ("null", 1.0, 1.0, 0.05),  # 150 tables of 8 rows or more: 0.02
        ("understated", 1.8, 1.8, 0.12),
        ("student", 1.0, 0.8 * 3**0.5, 0.12),
        ("batch", 2.0, 5**0.5, 0.12),
        ("offset", 4.0, 17**0.5, 0.12),
    ],
)
def test_a_disturbance_has_its_size(disturbance, size, expected, within):
    spread = np.std(np.concatenate([error for _, error in tables(disturbance, size, 150)]))
    assert spread == pytest.approx(expected, rel=within)


def test_rows_of_one_batch_share_their_error():
    within = []
    for table, error in tables("batch", 20.0, 30):
        labels = np.array(table.group)
        within += [np.std(error[labels == name], ddof=1) for name in set(labels) if sum(labels == name) > 2]
    assert np.mean(within) < 1.2, "the batch's own error of 20 sd is common"


def test_the_second_source_is_off_and_has_the_coarse_half():
    for table, error in tables("coarse_source", 30.0, 10):
        second = np.array(table.source) == "laboratory B"
        assert abs(abs(error[second].mean() - error[~second].mean()) - 30.0) < 3.0
        assert table.conditions["diameter"][second].min() >= table.conditions["diameter"][~second].max()


def test_rows_that_cannot_change_have_the_values_of_rows_that_can():
    model = CaseModel(1.0, 0.3, {})

    def value(diameter: Floats, strength: float = 1.0) -> Floats:
        return model("threshold_u_star", {"diameter": diameter}, {}, {"gusts": strength}, np.array([3, 8]))

    fresh = np.geomspace(1e-4, 1e-3, 6)
    fixed = fresh.copy()
    fixed.setflags(write=False)
    expected = value(fresh)
    assert not model.states, "rows that may change are not kept"
    for _ in ("new", "kept"):
        assert np.array_equal(value(fixed), expected)
    assert len(model.states) == 1
    assert not np.array_equal(value(fixed, 2.0), expected)
