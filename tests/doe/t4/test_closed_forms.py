"""Forms of the literature, computed by hand at one sand and one wind."""

from collections.abc import Mapping
from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from doe.t4 import closed_forms
from doe.t4.closed_forms import FLUID, IMPACT, ClosedForm
from taichi_erosion.evidence.data.problem import Measurements


def rows(at: Mapping[str, float], observable: str = "flux") -> Measurements:
    """One row."""
    return Measurements(
        observable=(observable,),
        value=np.array([1.0]),
        sd=np.array([0.1]),
        n=np.ones(1),
        group=("interval 1",),
        unit=("",),
        conditions={name: np.array([value]) for name, value in at.items()},
        censored=np.zeros(1, dtype=np.bool_),
        limit=np.full(1, np.nan),
        source=("a laboratory",),
    )


def test_thresholds_of_quartz():
    at = {"diameter": 2.5e-4, "air_density": 1.2}
    assert closed_forms.bagnold(rows(at))[0] == pytest.approx(0.08 * sqrt(2648.8 / 1.2 * 9.81 * 2.5e-4))
    fluid = sqrt(0.0123 * (2650.0 / 1.2 * 9.81 * 2.5e-4 + 3e-4 / (1.2 * 2.5e-4)))
    assert closed_forms.shao_lu(rows(at, FLUID))[0] == pytest.approx(fluid)
    assert closed_forms.shao_lu(rows(at, IMPACT))[0] == pytest.approx(0.82 * fluid)


def test_fluxes_vanish_at_the_threshold_and_follow_their_powers_above():
    at = {"diameter": 2.5e-4, "air_density": 1.2}
    threshold = float(closed_forms.bagnold(rows(at))[0])
    for form in (closed_forms.kok, closed_forms.kawamura):
        assert form(rows({"u_star": threshold, **at}))[0] == pytest.approx(0.0, abs=1e-15)
        assert form(rows({"u_star": 0.5 * threshold, **at}))[0] == 0.0
    twice = rows({"u_star": 2.0 * threshold, **at})
    assert closed_forms.kok(twice)[0] == pytest.approx(5.0 * 1.2 / 9.81 * 3.0 * threshold**3)
    assert closed_forms.kawamura(twice)[0] == pytest.approx(2.78 * 1.2 / 9.81 * 9.0 * threshold**3)


def test_a_site_with_a_measured_threshold_has_that_one():
    known = replace(rows({"diameter": 4e-4}), source=("Martin Oceano",))
    assert closed_forms.thresholds_of(known)[0] == pytest.approx(sqrt(0.085 / 1.22), rel=1e-5)


def test_a_level_comes_from_the_fitted_rows_alone():
    form = ClosedForm("growth", closed_forms.owen_height, level=True)
    fitted = replace(rows({"u_star": 0.4}), value=np.array([0.08]))
    held_out = replace(rows({"u_star": 0.8}), value=np.array([99.0]))
    assert form.at(fitted, held_out)[0] == pytest.approx(0.32)


def test_the_threshold_falls_by_the_ratio_of_the_measured_stresses():
    none, all_time = (closed_forms.falling_threshold(rows({"activity": f}))[0] for f in (0.0, 1.0))
    assert none == 1.0
    assert all_time == pytest.approx(sqrt(0.085 / 0.133), rel=1e-5)


def test_the_profile_of_an_interval_has_its_own_height():
    height = closed_forms.interval_heights()["interval 1"]
    assert height == pytest.approx(0.113, rel=0.05)  # as its source fitted it
    found = closed_forms.exponential_profile(rows({"trap_bottom": 0.0, "trap_top": height}))[0]
    assert found * height == pytest.approx(1.0 - np.exp(-1.0))
