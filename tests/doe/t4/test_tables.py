"""Tidy tables of published series: fits of profiles, and the share of time of each bin."""

from itertools import pairwise

import numpy as np
import pytest

from doe.t4.tables import fitted_height, lines, rounding, threshold_by_activity, trap_density

EDGES = (0.0, 0.025, 0.05, 0.1, 0.15, 0.25, 0.35)  # m


def traps(height: float) -> list[dict[str, str]]:
    """Catches of an exponential profile."""
    found = []
    for low, high in pairwise(EDGES):
        catch = np.exp(-low / height) - np.exp(-high / height)
        place = {"trap_top_height_m": str(high), "trap_height_m": str(high - low)}
        found.append(place | {"weight_g": str(catch), "duration_s": "120", "trap_width_m": "0.1"})
    return found


def test_the_density_of_a_trap_is_its_catch_over_time_and_area():
    low, high, density = trap_density(traps(0.1)[1])
    assert (low, high) == pytest.approx((0.025, 0.05))
    assert density == pytest.approx((np.exp(-0.25) - np.exp(-0.5)) / (120.0 * 0.1 * 0.025))


def test_the_height_of_an_exponential_profile_is_found_from_traps_of_unequal_height():
    height, error = fitted_height(traps(0.08))
    assert height == pytest.approx(0.08, rel=1e-6)
    assert error < 1e-6


def test_the_error_of_a_printed_number_is_half_of_its_last_digit():
    assert rounding("0.22") == pytest.approx(0.005)


def test_minutes_of_like_activity_are_repeats(tmp_path, monkeypatch: pytest.MonkeyPatch):
    head = "saltation_activity_fQ,u_threshold_TFEM_m_s,zL_stability"
    source = tmp_path / "threshold_field_oceano_1min_tfem.csv"
    source.write_text(f"{head}\n0.1,6.0,-0.07\n0.2,7.0,-0.07\n0.9,5.0,-0.07\n0.1,6.5,-0.08\n")
    monkeypatch.setattr("doe.t4.tables.HERE", tmp_path)
    threshold_by_activity(tmp_path)
    rows = lines(tmp_path, "threshold_by_activity")
    assert [(row["value"], row["n"], row["source"]) for row in rows] == [
        ("6.5", "2", "Oceano half hour 1"),
        ("5", "1", "Oceano half hour 1"),
        ("6.5", "1", "Oceano half hour 2"),
    ]
    assert float(rows[0]["sd"]) == pytest.approx(np.sqrt(0.5), rel=1e-5)
