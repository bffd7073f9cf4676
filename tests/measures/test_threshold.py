"""Thresholds of several beds, and the wind speed of a tunnel."""

import csv
from dataclasses import replace
from math import hypot
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import t as student

from taichi_erosion.measures.threshold import (
    PLATE,
    Bracket,
    Tunnel,
    free_stream,
    friction_velocity_at_zero_flux,
    pool_beds,
    ratio,
    threshold_from_bracket,
    threshold_from_line,
    tunnel_speed,
)


def beds(thresholds: np.ndarray, width: float, seed: int = 0):
    """Brackets of a relative width around thresholds, each where chance puts it."""
    below = np.random.default_rng(seed).random(len(thresholds))
    ends = zip(thresholds * np.exp(-width * below), thresholds * np.exp(width * (1.0 - below)), strict=True)
    return [threshold_from_bracket("fluid_threshold", Bracket(low, high)) for low, high in ends]


def test_the_interval_of_many_series_of_five_beds_holds_the_truth_as_often_as_it_says():
    random = np.random.default_rng(1)
    held = 0
    for seed in range(100):
        found = pool_beds(beds(0.3 * np.exp(random.normal(0.0, 0.05, 5)), 0.02, seed)).details["interval"]
        held += found["low"] < 0.3 < found["high"]
    # 95 of 100 with a standard deviation of 2.2
    assert 88 <= held <= 100


def test_narrow_brackets_give_the_mean_and_nearly_students_interval():
    thresholds = 0.25 * np.exp([-0.06, -0.02, 0.0, 0.03, 0.05])
    pooled = pool_beds(beds(thresholds, 1e-3))
    spread = np.log(thresholds).std(ddof=1)
    half = student.ppf(0.975, 4) * spread / np.sqrt(5)
    found = pooled.details["interval"]
    # a logistic law is not a normal one: tails are longer, the middle is nearly the same
    assert pooled.value == pytest.approx(np.exp(np.log(thresholds).mean()), rel=0.01)
    assert pooled.sd / pooled.value == pytest.approx(spread, rel=0.25)
    assert np.log(found["high"] / found["low"]) == pytest.approx(2.0 * half, rel=0.25)


def test_lines_and_fluxes_of_several_beds_are_pooled_by_their_mean_for_they_bound_nothing():
    lines = [threshold_from_line(Bracket(u - 0.02, u + 0.02)) for u in (0.15, 0.16, 0.17)]
    assert lines[0].sd == pytest.approx(0.02)
    pooled = pool_beds(lines)
    # the middle of a bracket is its geometric mean: half of 0.02^2 / 0.16 below
    assert pooled.value == pytest.approx(0.16, rel=0.01)
    assert pooled.sd == pytest.approx(0.01, rel=0.02), "beds differ, though all brackets overlap"
    half = student.ppf(0.975, 2) * pooled.sd / np.sqrt(3)
    ends = pooled.details["interval"]
    assert (ends["low"], ends["high"]) == pytest.approx((pooled.value - half, pooled.value + half))
    assert pool_beds([replace(each, name="flux") for each in lines]).details["interval"] == ends
    assert "interval" not in pool_beds(lines[:1]).details


def test_beds_with_the_same_ratio_leave_open_what_their_brackets_do():
    impact, fluid = (threshold_from_bracket("", Bracket(*ends)) for ends in ((0.15, 0.17), (0.24, 0.25)))
    single = ratio("threshold_ratio", impact, fluid)
    assert (single.details["low"], single.details["high"]) == pytest.approx((0.6, 0.17 / 0.24))
    ends = pool_beds([single] * 3).details["interval"]
    assert (ends["low"] < 0.62, ends["high"] > 0.68) == (True, True)
    assert ratio("threshold_ratio_linear", threshold_from_line(Bracket(0.15, 0.17)), fluid).details == {}


def test_the_line_of_flux_against_stress_ends_at_the_threshold_within_its_own_error():
    random = np.random.default_rng(4)
    winds = np.array([0.5, 0.46, 0.42, 0.38, 0.34, 0.3])
    inside = 0
    for _ in range(200):
        blown = 0.2 * (winds**2 - 0.2**2) * (1.0 + random.normal(0.0, 0.03, 6))
        found = friction_velocity_at_zero_flux(list(zip(winds, blown, strict=True)))
        inside += found.low < 0.2 < found.high
    # one standard error on four degrees of freedom holds 63 % of 200 with a standard deviation of 3.4 %
    assert 0.52 < inside / 200 < 0.74


def test_what_has_no_value_has_none():
    brackets = {"fluid": Bracket(0.24, 0.26), "impact": Bracket(0.19, 0.21), "none": None}
    fluid, impact, none = (threshold_from_bracket(name, bracket) for name, bracket in brackets.items())
    line = ratio("threshold_ratio_linear", threshold_from_line(brackets["impact"]), fluid)
    assert ratio("threshold_ratio", impact, fluid).value == pytest.approx(0.8, rel=0.01)
    assert (line.value, line.sd) == pytest.approx((0.8, 0.8 * hypot(0.05, 0.0231)), rel=0.01)
    assert ratio("threshold_ratio", none, fluid).n == 0
    assert threshold_from_line(None).n == 0
    # a line needs four winds that blow, and a threshold
    tail = [(0.5, 1.0), (0.4, 0.6), (0.3, 0.3), (0.25, 0.01), (0.2, 0.001)]
    for winds in (tail, [(u, u**2) for u in (0.5, 0.4, 0.3, 0.2)], []):
        assert friction_velocity_at_zero_flux(winds) is None


def test_the_speed_over_a_flat_plate_is_that_of_the_textbook_seven_metres_from_its_edge():
    friction = {(6.3, 0.1): 0.239, (6.3, 0.25): 0.248, (6.3, 0.5): 0.258}
    friction |= {(6.9, 0.25): 0.271, (6.9, 2.0): 0.321}
    for (speed, millimetres), known in friction.items():
        # friction velocities of the table are rounded to a millimetre per second
        tunnel = Tunnel(7.0, 1e-3 * millimetres, 1.5e-5)
        assert free_stream(known, tunnel, PLATE) == pytest.approx(speed, rel=0.01)


def test_the_speed_of_the_tunnel_is_that_of_the_simulated_working_section():
    with (Path(__file__).parents[2] / "doe" / "tunnel_map" / "map.csv").open() as file:
        rows = list(csv.DictReader(file))
    for row in rows:  # made with the roughness of 0.25 mm, rounded to micrometres, and six digits
        found = free_stream(float(row["friction_velocity"]), Tunnel(float(row["place"]), 0.25e-3, 1.5e-5))
        assert found == pytest.approx(float(row["speed"]), rel=1e-3)


def test_beds_share_the_uncertainty_of_the_map():
    tunnel = Tunnel(6.0, 0.25e-3, 1.5e-5)
    brackets = Bracket(0.275, 0.285), Bracket(0.315, 0.325)
    pooled = pool_beds([tunnel_speed("threshold_wind_speed", each, tunnel) for each in brackets])
    assert pooled.value == pytest.approx(free_stream(0.299, tunnel), rel=0.01)
    # 5.6 % of u*, and a little more of the speed, which grows faster than u*
    assert 0.056 < pooled.details["shared_sd"] / pooled.value < 0.065
    assert pooled.details["flat_plate"] == pytest.approx(free_stream(0.299, tunnel, PLATE), rel=0.01)


def test_a_tunnel_of_ones_own_needs_no_map():
    found = tunnel_speed("threshold_wind_speed", Bracket(0.24, 0.25), Tunnel(6.0, 0.25e-3, 1.5e-5, 0.048))
    assert (found.value, set(found.details)) == (pytest.approx(0.06**0.5 / 0.048), {"low", "high"})
    assert pool_beds([found, found]).notes == ()  # of the map
