"""The closed form: conditions that its threshold reads."""

import numpy as np
import pytest

from taichi_erosion.evidence.models import reduced


def test_the_threshold_grows_with_the_root_of_the_submerged_weight():
    density = np.array([1050.0, reduced.GRAIN_DENSITY, 4000.0])
    given = reduced.expected("threshold_u_star", {"grain_density": density}, {}, {})
    usual = reduced.expected("threshold_u_star", {"diameter": np.full(3, reduced.MEDIAN_DIAMETER)}, {}, {})
    submerged = (density - reduced.AIR_DENSITY) / (reduced.GRAIN_DENSITY - reduced.AIR_DENSITY)
    assert given / usual == pytest.approx(np.sqrt(submerged))
