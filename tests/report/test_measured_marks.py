"""Marks of measured values."""

import pandas as pd

from taichi_erosion.report.answer_figures import marked


def test_limits_are_marked_by_the_side_on_which_the_value_lies():
    limit = ["below", "", "above", "between", "", ""]
    points = pd.DataFrame({"measured": [20.0, 22.0, 25.0, 27.0, 30.0, 33.0], "limit": limit})
    found = {kind: own["measured"].to_list() for kind, own in marked(points)}
    assert found == {"": [22.0, 30.0, 33.0], "below": [20.0], "above": [25.0], "between": [27.0]}
    assert list(found)[-1] == ""  # drawn last, above the others
