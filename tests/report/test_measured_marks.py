"""Axes that one value cannot spoil, and marks of limits and of values beyond the axis."""

import numpy as np

from taichi_erosion.report.pictures.measured_marks import kinds, value_range

VALUES = np.array([20.0, 22.0, 25.0, 27.0, 30.0, 33.0])


def test_an_outlier_does_not_stretch_the_axis_and_is_marked_at_its_edge():
    values = np.append(VALUES, 900.0)
    shown = value_range(values, values)
    assert 30.0 < shown.high < 40.0
    marked = {kind: chosen.tolist() for kind, chosen in kinds(values, ("",) * 7, shown) if chosen.any()}
    assert marked == {"": [True] * 6 + [False], "high": [False] * 6 + [True]}


def test_values_over_decades_are_no_outliers_on_a_logarithmic_axis():
    values = np.geomspace(0.1, 1000.0, 12)
    shown = value_range(values, values)
    assert shown.logarithmic
    assert not any(map(np.any, shown.beyond(values)))


def test_bars_of_a_single_value_are_seen_whole_and_those_of_a_bad_row_are_not():
    shown = value_range(np.array([25.4, 25.5]), np.array([25.0, 26.0]))
    assert shown.low < 25.0 < 26.0 < shown.high
    bars = np.concatenate([VALUES - 1.0, VALUES + 1.0, [-500.0, 500.0]])
    shown = value_range(VALUES, bars)
    assert 0.0 < shown.low < 19.0
    assert 34.0 < shown.high < 60.0


def test_limits_are_marked_by_the_side_on_which_the_value_lies():
    limit = ("below", "", "above", "between", "", "")
    found = {kind: int(chosen.sum()) for kind, chosen in kinds(VALUES, limit, value_range(VALUES, VALUES))}
    assert found == {"": 3, "below": 1, "above": 1, "between": 1, "high": 0, "low": 0}
