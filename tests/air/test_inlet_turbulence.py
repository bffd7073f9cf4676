"""Statistics of the fluctuations at an inlet."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.air.inlet_turbulence import draw_waves
from taichi_erosion.core.air_setup import InletTurbulence


def test_inlet_fluctuations_have_the_stated_deviation_and_no_mean():
    turbulence = InletTurbulence((0.5, 0.3, 0.2), length=0.1, seed=3, waves=400)
    vector, amplitude, phase = draw_waves(turbulence)
    rng = np.random.default_rng(1)
    place = rng.uniform(0.0, 50.0, (4000, 3))
    blown = np.cos(place @ vector.T + phase) @ amplitude
    # 400 random directions leave a scatter of a few per cent in each component
    assert blown.std(axis=0) == pytest.approx(turbulence.deviation, rel=0.15)
    assert np.abs(blown.mean(axis=0)).max() < 0.03
    other = draw_waves(replace(turbulence, seed=4))
    assert not np.array_equal(other[2], phase)
