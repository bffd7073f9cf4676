"""Thresholds of other criteria: closed forms, and beds drawn from the law that is fitted."""

from math import exp, log

import numpy as np
import pytest
from scipy.special import gammainc, ndtr, ndtri

from doe.wind.extremes import SHAPES, Watch, best_slope, criterion_threshold, lognormal_rate, weibull_rate
from taichi_erosion.measures.threshold import Bracket

PATCH = Watch(area=1.2e-5, time=0.3)  # m2, s
FLOOR = Watch(area=0.5, time=60.0)
SCALE, SLOPE = 0.3, 12.0  # m s-1, 1: of the law that beds are drawn from


def narrow(wind: float) -> Bracket:
    """A bracket of one percent about a threshold [m s-1]."""
    return Bracket(wind * 0.995, wind * 1.005)


def weibull_beds(count: int, seed: int, needed: int = 1) -> list[Bracket]:
    """Beds whose mean number of movers is (u*/SCALE)^SLOPE, each at the wind of its `needed`-th mover."""
    means = np.random.default_rng(seed).gamma(needed, size=count)
    return [narrow(SCALE * mean ** (1.0 / SLOPE)) for mean in means]


def test_the_threshold_of_a_floor_follows_from_the_weakest_of_many():
    found = criterion_threshold("first", weibull_beds(300, 1), PATCH, FLOOR)
    # L = (u*/c)^k grows with area and time, and half of all floors move at L = ln 2
    want = SCALE * (log(2.0) * PATCH.size / FLOOR.size) ** (1.0 / SLOPE)
    # the slope of 300 beds is known to 5 %, and ln(u*) to that of 17 / 12
    assert found.value == pytest.approx(want, rel=0.1)
    assert found.details["slope"] == pytest.approx(SLOPE, rel=0.15)
    assert found.details["interval"]["low"] < want < found.details["interval"]["high"]


def test_without_a_change_of_criterion_the_threshold_is_the_median_of_the_beds():
    beds = weibull_beds(300, 2, needed=2)
    watch = Watch(PATCH.area, PATCH.time, 2)
    found = criterion_threshold("same", beds, watch, watch)
    assert found.value == pytest.approx(np.median([bed.middle for bed in beds]), rel=0.01)


def test_more_grains_in_the_same_watch_need_more_wind():
    # a mean of 2.674 gives three grains in half of all trials, one of 0.693 one
    found = criterion_threshold("three", weibull_beds(300, 3), PATCH, Watch(PATCH.area, PATCH.time, 3))
    assert found.value == pytest.approx(SCALE * 2.674 ** (1.0 / SLOPE), rel=0.02)


def test_the_lognormal_law_is_a_sum_of_attempts():
    attempts = 1e9  # m-2 s-1: 3600 in the patch
    middle, width = log(0.8), 0.25
    rng = np.random.default_rng(4)
    chances = rng.exponential(size=300) / (attempts * PATCH.size)
    beds = [narrow(exp(middle + width * ndtri(chance))) for chance in chances]
    found = criterion_threshold("first", beds, PATCH, FLOOR, attempts)
    want = exp(middle + width * ndtri(log(2.0) / (attempts * FLOOR.size)))
    assert found.value == pytest.approx(want, rel=0.05)
    # d ln Phi / d ln u* where half of the patches move
    z = ndtri(log(2.0) / (attempts * PATCH.size))
    slope = exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi) / ndtr(z) / width
    assert found.details["slope"] == pytest.approx(slope, rel=0.15)


def test_the_interval_of_few_beds_holds_the_truth_about_as_often_as_it_says():
    watch = Watch(PATCH.area, 2.0 * PATCH.time)
    want = SCALE * (log(2.0) / 2.0) ** (1.0 / SLOPE)
    intervals = [
        criterion_threshold("twice", weibull_beds(8, 100 + seed), PATCH, watch).details["interval"]
        for seed in range(50)
    ]
    held = sum(each["low"] <= want <= each["high"] for each in intervals)
    # 47.5 expected of 50, with a deviation of 1.5
    assert held >= 43
    assert np.median([each["high"] / each["low"] for each in intervals]) < 1.4


def test_the_likelihood_is_that_of_the_brackets():
    bracket = np.log([[0.28, 0.31]])
    slope, likely = best_slope(weibull_rate(PATCH, PATCH), bracket, 1, log(0.3))
    means = log(2.0) * (np.array([0.28, 0.31]) / 0.3) ** slope
    assert likely == pytest.approx(log(gammainc(1, means[1]) - gammainc(1, means[0])))
    assert slope in SHAPES


def test_too_few_beds_say_nothing():
    assert np.isnan(criterion_threshold("few", weibull_beds(2, 1), PATCH, FLOOR).value)


def test_a_criterion_of_more_grains_than_attempts_is_refused():
    with pytest.raises(ValueError, match="more grains than half of the attempts"):
        lognormal_rate(PATCH, Watch(PATCH.area, PATCH.time, 100), 1e7)
