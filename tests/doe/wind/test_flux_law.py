"""Which law the flux obeys is found again, with its error; steady winds over a sand have one threshold."""

from math import nan, sqrt

import numpy as np
import pytest

from doe.common.cases import Row, by_case
from doe.wind.flux_law import CUBIC, LINEAR, flux_power
from doe.wind.saturated_sand import AIR, STRESS_LINE, saturated_thresholds
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
    found = [flux_power(WINDS, flux(LINEAR, SCATTER, seed), SHARP) for seed in range(400)]
    line, cube = (np.mean([power.chance(law) < 0.05 for power in found]) for law in (LINEAR, CUBIC))
    assert cube > 0.8
    # 400 series: the share of a twentieth is known to 0.011
    assert line == pytest.approx(0.05, abs=0.035)


def test_an_open_threshold_leaves_the_exponent_open():
    sharp = flux_power(WINDS, flux(LINEAR, SCATTER), SHARP)
    vague = flux_power(WINDS, flux(LINEAR, SCATTER), Bracket(0.15, 0.19))
    assert vague.error > 1.2 * sharp.error


def row(wind: float, name: str, value: float) -> Row:
    where = "impact", f"0.25 mm, u* {wind:g}"
    return Row(*where, name, value, nan, 1, "Pa", "hash", 1, 1e-6, 0.2, 800, 1.0, "run", "")


def test_the_threshold_is_the_wind_whose_stress_the_air_keeps():
    found = []
    for wobble in (0.0, 0.01):  # Pa more under the first and the last wind
        left = AIR * THRESHOLD**2 + wobble * np.isin(WINDS, WINDS[[0, -1]])
        rows = [row(u, "flux", 0.01) for u in WINDS]
        rows += [row(u, "bed_stress", stress) for u, stress in zip(WINDS, left, strict=True)]
        rows += [row(u, "grain_stress", AIR * u**2 - stress) for u, stress in zip(WINDS, left, strict=True)]
        (name, lines), *others = saturated_thresholds(by_case(rows)).items()
        assert name == ("impact", "0.25")
        assert not others
        found.append(lines[STRESS_LINE])
    exact, rough = found
    assert exact.value == pytest.approx(THRESHOLD, rel=1e-6)
    # what scatters about the line is its error
    assert exact.standard_error < 1e-6
    # 0.01 Pa more or less is a tenth of u_t there, of which six winds leave some
    assert 0.1 * 0.5 * 0.01 / (AIR * THRESHOLD) < rough.standard_error < 0.01 / (AIR * THRESHOLD)
    assert rough.standard_error == pytest.approx(rough.sd / sqrt(len(WINDS)))
