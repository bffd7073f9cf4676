"""Fits of discharge and heap correlations return the law that they were given."""

import numpy as np
import pytest

from tests.verification.reference import flow as bulk

OPENINGS, GRAIN = 0.002 * np.repeat([6.0, 8.0, 11.0, 15.0], 4), 0.002
SCATTER = 0.05  # of a flow from filling to filling


def flows(exponent: float, seed: int = 0, scatter: float = SCATTER) -> np.ndarray:
    noise = np.exp(scatter * np.random.default_rng(seed).standard_normal(OPENINGS.size))
    return 7.0 * (OPENINGS - 1.5 * GRAIN) ** exponent * noise


@pytest.mark.parametrize("exponent", [1.5, 2.5])
def test_beverloo_fits_return_the_law_they_were_given(exponent: float) -> None:
    exact = flows(exponent, scatter=1e-9)
    assert bulk.discharge_exponent(OPENINGS, GRAIN, exact, 1.5)[0] == pytest.approx(exponent, rel=1e-6)
    assert bulk.discharge_edge(OPENINGS, GRAIN, exact, exponent)[0] == pytest.approx(1.5, rel=1e-5)


def test_errors_of_beverloo_fits_are_those_of_repeated_fillings() -> None:
    series = [flows(2.5, seed) for seed in range(300)]
    slopes = np.array([bulk.discharge_exponent(OPENINGS, GRAIN, flow, 1.5) for flow in series])
    edges = np.array([bulk.discharge_edge(OPENINGS, GRAIN, flow, 2.5) for flow in series])
    for found in (slopes, edges):
        # the scatter of 300 series is known to 4 %, and so is the mean of their errors
        assert found[:, 1].mean() == pytest.approx(found[:, 0].std(ddof=1), rel=0.15)
    # one true law in twenty has a p below 0.05
    assert (edges[:, 2] < 0.05).mean() == pytest.approx(0.05, abs=0.04)


def test_the_lack_of_fit_refutes_another_exponent() -> None:
    chances = [bulk.discharge_edge(OPENINGS, GRAIN, flows(1.5, seed, 0.01), 2.5)[2] for seed in range(20)]
    assert np.median(chances) < 1e-3


@pytest.mark.parametrize("exponent", [1.5, 2.5])
def test_the_coefficient_of_a_discharge_is_the_one_in_its_law(exponent: float) -> None:
    density, width, diameter = np.full(2, 1500.0), np.array([0.012, 0.022]), 0.002
    flow = 0.6 * density * np.sqrt(9.81) * (width - 1.4 * diameter) ** exponent
    found = bulk.discharge_coefficient(flow, density, width, diameter, exponent)
    assert found == pytest.approx(0.6)


def test_zhou_formula_gives_the_angle_of_the_known_example() -> None:
    # Lethe's plate discharge example: 10 mm, friction 0.2, rolling friction 0.1 diameters; 19.7 deg
    assert bulk.zhou_angle(0.2, 0.2, 1e-3, 1e-3, 0.010) == pytest.approx(19.7, abs=0.05)
