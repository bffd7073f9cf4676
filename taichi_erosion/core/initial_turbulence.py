"""The wind that sets in over a bed: a logarithmic mean, and waves of random phases from which eddies grow.

    u = (u*/kappa) ln(1 + z / z0),    u'_i = A_i sum_n cos(k_n . x + p_in) sin(pi m_n z / H)

over the waves that are periodic in the patch, m half waves high, of equal amplitudes, with z counted from the
bed [m]. Each u'_i has the standard deviation s u* over the air above the bed; the first projection takes from
it what is not free of divergence. In the bed the air is at rest.

Reference: Moin & Kim (1982), J. Fluid Mech. 118, 341 (turbulence grown from random fluctuations on a mean).
"""

from itertools import product

import numpy as np

from taichi_erosion.core.air_setup import AirSetup, log_profile
from taichi_erosion.core.setup import Floats

WAVES_X, WAVES_Y, HALF_WAVES = 2, 3, 3  # largest numbers of waves along x and y, and of half waves up


def stirred_wind(setup: AirSetup, friction_velocity: float) -> Floats:
    """First velocities [3, nx, ny, nz] in m s-1 under a friction velocity [m s-1]."""
    assert setup.stir is not None
    centre = 0.5 * (setup.faces_z[1:] + setup.faces_z[:-1]) - setup.ground
    wind = np.zeros((3, *setup.cells))
    wind[0] = log_profile(centre, friction_velocity, setup.stir.roughness, setup.constants.karman)
    waves = random_waves(setup, np.maximum(centre, 0.0) / (setup.high[2] - setup.ground))
    return wind + setup.stir.deviation * friction_velocity * waves


def random_waves(setup: AirSetup, height: Floats) -> Floats:
    """Fluctuations [3, nx, ny, nz] of standard deviation 1 above the bed [1]; heights over the lid's."""
    assert setup.stir is not None
    random = np.random.Generator(np.random.Philox(setup.stir.seed))
    x, y = (2.0 * np.pi * np.arange(n) / n for n in setup.cells[:2])
    total = np.zeros((3, *setup.cells))
    for a, b, m in product(range(WAVES_X + 1), range(-WAVES_Y, WAVES_Y + 1), range(1, HALF_WAVES + 1)):
        phase = random.uniform(0.0, 2.0 * np.pi, 3)
        level = np.cos(a * x[None, :, None] + b * y[None, None, :] + phase[:, None, None])
        total += level[..., None] * np.sin(np.pi * m * height)
    above = height > 0.0
    deviation = np.sqrt((total[..., above] ** 2).mean(axis=(1, 2, 3), keepdims=True))
    return total / np.maximum(deviation, np.finfo(float).tiny)
