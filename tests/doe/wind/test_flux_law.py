"""Which law the flux obeys is found again, with its error."""

import numpy as np
import pytest

from doe.wind.flux_law import CUBIC, LINEAR, flux_power
from taichi_erosion.measures.threshold import Bracket

WINDS = np.array([0.28, 0.34, 0.40, 0.46, 0.52, 0.60])  # m s-1
THRESHOLD = 0.17  # m s-1
SHARP = Bracket(THRESHOLD - 1e-9, THRESHOLD + 1e-9)
SCATTER = 0.1  # of a flux, as over seconds


def flux(power: float, scatter: float = 0.0, seed: int = 0) -> np.ndarray:
    noise = np.exp(scatter * np.random.default_rng(seed).standard_normal(WINDS.size))
    return 0.2 * (WINDS**2 - THRESHOLD**2) * (WINDS + THRESHOLD) ** power * noise


@pytest.mark.parametrize("power", [LINEAR, CUBIC, 0.4])
def test_the_exponent_of_a_law_is_found_again(power: float):
    found = flux_power(WINDS, flux(power), SHARP)
    assert found.value == pytest.approx(power, abs=1e-6)


def test_six_winds_tell_a_line_from_a_cube():
    # with a tenth of scatter the other law is refuted in most series, the true one in one of twenty
    refuted = {law: np.zeros(400) for law in (LINEAR, CUBIC)}
    for seed in range(400):
        found = flux_power(WINDS, flux(LINEAR, SCATTER, seed), SHARP)
        for law, tally in refuted.items():
            tally[seed] = found.chance(law) < 0.05
    assert refuted[CUBIC].mean() > 0.8
    # 400 series: the share of a twentieth is known to 0.011
    assert refuted[LINEAR].mean() == pytest.approx(0.05, abs=0.035)


def test_an_open_threshold_leaves_the_exponent_open():
    sharp = flux_power(WINDS, flux(LINEAR, SCATTER), SHARP)
    vague = flux_power(WINDS, flux(LINEAR, SCATTER), Bracket(0.15, 0.19))
    assert vague.error > 1.2 * sharp.error
