"""Closed forms of published series: limits, and what an effect of textbook strength does."""

import numpy as np
import pytest

from doe.trials.published import models
from taichi_erosion.evidence.models import reduced

SEEDS = np.arange(3)


def asked(observable: str, at: dict[str, list[float]], given: dict[str, float], **effects: float):
    conditions = {name: np.array(column) for name, column in at.items()}
    found = models.predict(observable, conditions, given, effects, SEEDS)
    assert (found == found[0]).all()
    return found[0]


def test_thresholds_and_flux_are_those_of_the_reduced_model_and_the_impact_threshold_a_share():
    at, given = {"diameter": np.array([1e-4, 1e-3])}, {"threshold_coefficient": 0.09}
    for name, effects in (("threshold_u_star", {"dry_cohesion": 1.0}), ("flux", {"gusts": 0.5})):
        found = models.predict(name, at, given, effects, SEEDS)
        assert found[0] == pytest.approx(reduced.expected(name, at, given, effects))
    at, given = {"diameter": [2e-4, 5e-4]}, {"threshold_coefficient": 0.1, "threshold_ratio": 0.8}
    fluid = asked("fluid_threshold_u_star", at, given, dry_cohesion=1.0)
    assert asked("impact_threshold_u_star", at, given, dry_cohesion=1.0) == pytest.approx(0.8 * fluid)


def test_unstable_air_has_a_slower_wind_at_the_same_stress_and_neutral_air_has_not():
    at = {"activity": [0.0, 0.0], "stability": [0.0, -0.1]}
    neutral, unstable = asked("threshold_wind_speed", at, {"threshold_wind": 6.0}, unstable_air=1.0)
    assert neutral == pytest.approx(6.0)
    # the integral of (1 - (1 - 16 z)^(-1/4)) / z from 0 to 0.1 is Psi_m
    z = np.linspace(1e-7, 0.1, 200_001)
    shift = np.trapezoid((1.0 - (1.0 + 16.0 * z) ** -0.25) / z, z)
    log_height = np.log(30.0 * models.ANEMOMETER / models.OCEANO_DIAMETER)
    assert unstable == pytest.approx(6.0 * (1.0 - shift / log_height), rel=1e-4)


@pytest.mark.parametrize("effects", [{}, {"many_heights": 0.4}, {"low_hops": 1.0}])
def test_the_traps_of_a_whole_profile_hold_the_whole_flux(effects):
    edges = np.concatenate([[0.0], np.geomspace(1e-3, 1e4, 200)])
    at = {"trap_bottom": edges[:-1].tolist(), "trap_top": edges[1:].tolist()}
    density = asked("flux_density_share", at, {"layer_height": 0.08}, **effects)
    assert np.sum(density * np.diff(edges)) == pytest.approx(1.0, abs=1e-6)
