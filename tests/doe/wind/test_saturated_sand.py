"""How steady winds over one sand become one threshold."""

from math import nan, sqrt

import pytest

from doe.common.cases import Found, Row, by_case
from doe.wind.saturated_sand import AIR, STRESS_LINE, saturated_thresholds

THRESHOLD = 0.2  # m s-1
WINDS = (0.3, 0.4, 0.5, 0.6)  # m s-1


def row(group: str, label: str, name: str, value: float) -> Row:
    return Row(group, label, name, value, nan, 1, "Pa", "hash", 1, 1e-6, 0.2, 800, 1.0, "run", "")


def blown(group: str = "impact", sand: str = "0.25", wobble: float = 0.0) -> Found:
    """Winds of which the air keeps the stress of the threshold, the first and the last `wobble` [Pa] more."""
    rows = []
    for place, wind in enumerate(WINDS):
        left = AIR * THRESHOLD**2 + (wobble if place in (0, 3) else 0.0)
        values = {"flux": 0.01, "bed_stress": left, "grain_stress": AIR * wind**2 - left}
        rows += [row(group, f"{sand} mm, u* {wind:g}", name, value) for name, value in values.items()]
    return by_case(rows)


def test_the_threshold_is_the_wind_whose_stress_the_air_keeps():
    (name, found), *others = saturated_thresholds(blown()).items()
    assert name == ("impact", "0.25")
    assert not others
    assert found[STRESS_LINE].value == pytest.approx(THRESHOLD, rel=1e-6)
    # what scatters about the line is its error
    exact, rough = (saturated_thresholds(blown(wobble=w))["impact", "0.25"][STRESS_LINE] for w in (0.0, 0.01))
    assert exact.standard_error < 1e-6
    # 0.01 Pa more or less is a tenth of u_t there, of which four winds leave some
    assert 0.1 * 0.5 * 0.01 / (AIR * THRESHOLD) < rough.standard_error < 0.01 / (AIR * THRESHOLD)
    assert rough.standard_error == pytest.approx(rough.sd / sqrt(len(WINDS)))
