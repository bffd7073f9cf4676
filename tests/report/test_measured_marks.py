"""Axes that one value cannot spoil, and marks of values beyond the axis."""

import numpy as np
import pandas as pd

from taichi_erosion.report.answer_figures import marked
from taichi_erosion.report.pictures.measured_marks import value_range

VALUES = np.array([20.0, 22.0, 25.0, 27.0, 30.0, 33.0])


def marks(values, limit="") -> dict[str, list[float]]:
    """Values by their mark."""
    points = pd.DataFrame({"measured": values, "limit": limit})
    return {kind: list(own["measured"]) for kind, own in marked(points, value_range(values, values))}


def test_an_outlier_does_not_stretch_the_axis_and_is_marked_at_its_edge():
    values = np.append(VALUES, 900.0)
    shown = value_range(values, values)
    assert 30.0 < shown.high < 40.0
    assert marks(values) == {"": VALUES.tolist(), "high": [900.0]}


def test_values_over_decades_are_no_outliers_on_a_logarithmic_axis():
    values = np.geomspace(0.1, 1000.0, 12)
    shown = value_range(values, values)
    assert shown.logarithmic
    assert set(marks(values)) == {""}


def test_bars_of_a_single_value_are_seen_whole_and_those_of_a_bad_row_are_not():
    shown = value_range(np.array([25.4, 25.5]), np.array([25.0, 26.0]))
    assert shown.low < 25.0 < 26.0 < shown.high
    bars = np.concatenate([VALUES - 1.0, VALUES + 1.0, [-500.0, 500.0]])
    shown = value_range(VALUES, bars)
    assert 0.0 < shown.low < 19.0
    assert 34.0 < shown.high < 60.0


def test_limits_are_marked_by_the_side_on_which_the_value_lies():
    limit = ["below", "", "above", "between", "", ""]
    found = marks(VALUES, limit)
    assert found == {"": [22.0, 30.0, 33.0], "below": [20.0], "above": [25.0], "between": [27.0]}
