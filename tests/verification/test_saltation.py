"""How the threshold of several beds together is read off their trials."""

from math import isnan, sqrt
from types import SimpleNamespace
from typing import Any

import pytest

from taichi_erosion.run.stages import Actor
from taichi_erosion.verification.saltation import impact_threshold

WINDS = [0.3 * 0.9**k for k in range(10)]  # m s-1
THRESHOLD, STEEP = 0.18, 0.14  # m s-1, and flux over the square of the wind


def bed(factor: float, ceased: float) -> Any:
    """A bed that carries a multiple of the straight line until the wind at which it comes to rest [m s-1]."""
    blown = [
        {"phase": "fall", "friction_velocity": u, "flux": factor * STEEP * (u**2 - THRESHOLD**2)}
        for u in WINDS
        if u > ceased
    ]
    start = {"phase": "start", "friction_velocity": 0.36, "flux": 1.0}
    return SimpleNamespace(hunt=SimpleNamespace(trials=[start, *blown]))


def test_beds_together_give_the_line_that_none_of_them_follows():
    found = impact_threshold([bed(0.6, THRESHOLD), bed(1.5, THRESHOLD), bed(0.9, THRESHOLD)])
    # the mean of three lines through one point; the start, which is no steady wind, is left out
    assert found.middle == pytest.approx(THRESHOLD, rel=1e-6)


def test_a_bed_that_has_come_to_rest_carries_nothing_in_weaker_winds():
    early = impact_threshold([bed(1.0, THRESHOLD), bed(1.0, 0.25)])
    # half the flux below 0.25 m/s makes the line steeper, and its zero the later
    assert THRESHOLD < early.middle < sqrt(0.25**2)


def test_beds_that_never_blew_have_no_line():
    assert isnan(impact_threshold([Actor(seed=1)]).middle)
