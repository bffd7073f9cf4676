"""Messages of failed replicas."""

import numpy as np
import pytest

from taichi_erosion.core.snapshot import Failure, Status
from taichi_erosion.run.sanity_checks import failure_message


@pytest.mark.parametrize(
    ("end", "words"),
    [
        (Failure(Status.OVERLAP, 0.5, 7, 9, 0.31), ("grain 7 overlaps grain 9 by 0.31 radii", "0.5 s")),
        (Failure(Status.OVERLAP, 0.5, 7, -3, 0.31), ("grain 7 overlaps wall piece 2",)),
        (Failure(Status.LOST, 0.25, 4, -1, -1.5), ("grain 4 left the domain", "-1.5 m")),
        (Failure(Status.NOT_FINITE, 0.25, 4, -1, np.nan), ("grain 4", "not a number")),
        (Failure(Status.ENERGY, 0.25, -1, -1, 0.2), ("energy grew by 0.2",)),
    ],
)
def test_a_failure_is_told_in_one_line_with_place_time_and_cause(end, words):
    said = failure_message(end, 11)
    assert all(word in said for word in ("seed 11", "likely cause", *words))
    assert "\n" not in said
