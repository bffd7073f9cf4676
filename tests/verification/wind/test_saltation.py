"""How thresholds of saturated transport and places of landing are read, against geometry and lines."""

from math import log, pi, sqrt

import numpy as np
import pandas as pd
import pytest

from tests.measures.heaps import snapshot_of
from tests.verification.reference.hopping import KARMAN
from tests.verification.wind.saltation import AIR, DROPS, STEADY, landing_heights, roughness, vanishing

DIAMETER = 2.5e-4  # m


def test_a_grain_lands_on_another_as_on_a_cap_of_twice_its_radius():
    # over a patch of A, a cap of radius d covers pi d^2 and is 2/3 d high in the mean; else the floor carries
    side = 3.0
    share = pi / side**2
    want = share * (0.5 + 2.0 / 3.0) + (1.0 - share) * 0.5
    bed = snapshot_of(DIAMETER * np.array([[0.1, 2.9, 0.5]]), DIAMETER)
    heights = landing_heights(bed, DIAMETER * np.array([side, side]), DIAMETER)
    # sd of one place is 0.34 d; four standard errors of the mean
    assert heights.mean() / DIAMETER == pytest.approx(want, abs=4.0 * 0.34 / sqrt(DROPS))
    assert heights.max() / DIAMETER == pytest.approx(1.5, abs=0.01)


def test_the_roughness_of_a_log_law_is_found_again():
    z0, friction = 1e-5, 0.3
    assert roughness(lambda z: friction / KARMAN * log(z / z0), friction, 0.02) == pytest.approx(z0, rel=1e-9)


THRESHOLD = 0.17  # m s-1


def test_momentum_that_the_air_above_gives_back_does_not_move_the_threshold():
    # the stress that arrives at the bed counts, not that of the lid: 0.03 Pa come down from above
    kept = AIR * THRESHOLD**2
    winds = pd.DataFrame({"grain_stress": [AIR * patch.wind**2 - kept + 0.03 for patch in STEADY]})
    assert vanishing(winds.assign(bed_stress=kept)).middle == pytest.approx(THRESHOLD, rel=1e-6)
