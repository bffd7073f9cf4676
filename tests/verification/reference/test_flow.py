"""Fits of discharge and heap correlations return the law that they were given."""

import numpy as np
import pytest

from taichi_erosion.verification.reference import flow as bulk


@pytest.mark.parametrize("exponent", [1.5, 2.5])
def test_beverloo_fits_return_the_law_they_were_given(exponent: float) -> None:
    orifice, diameter = np.array([0.01, 0.013, 0.016]), 0.002
    flow = 7.0 * (orifice - 1.5 * diameter) ** exponent
    assert bulk.discharge_fit(orifice, diameter, flow) == pytest.approx((1.5, exponent))
    assert bulk.discharge_edge(orifice, diameter, flow, exponent) == pytest.approx(1.5)


@pytest.mark.parametrize("exponent", [1.5, 2.5])
def test_the_coefficient_of_a_discharge_is_the_one_in_its_law(exponent: float) -> None:
    density, width, diameter = np.full(2, 1500.0), np.array([0.012, 0.022]), 0.002
    flow = 0.6 * density * np.sqrt(9.81) * (width - 1.4 * diameter) ** exponent
    found = bulk.discharge_coefficient(flow, density, width, diameter, exponent)
    assert found == pytest.approx(0.6)


def test_zhou_formula_gives_the_angle_of_the_known_example() -> None:
    # Lethe's plate discharge example: 10 mm, friction 0.2, rolling friction 0.1 diameters; 19.7 deg
    assert bulk.zhou_angle(0.2, 0.2, 1e-3, 1e-3, 0.010) == pytest.approx(19.7, abs=0.05)
