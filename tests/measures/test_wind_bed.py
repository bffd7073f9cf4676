"""Flux, its height and the stresses at the bed of made-up transport."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.core.snapshot import AirProfile, Snapshot
from taichi_erosion.measures import wind_bed
from tests.measures.heaps import snapshot_of

PATCH = wind_bed.Patch(area=2e-5, surface=1e-3, diameter=2.5e-4, density=1.2, viscosity=1.5e-5)


def flying(height: np.ndarray, speed: float) -> Snapshot:
    count = len(height)
    place = np.column_stack([np.zeros((count, 2)), height])
    velocity = np.tile([speed, 0.0, 0.0], (count, 1))
    return replace(snapshot_of(place), velocity=velocity, mass=np.full(count, 2e-8))


def test_flux_and_its_height_are_those_of_the_transport_that_was_made():
    random = np.random.default_rng(2)
    frames = [flying(1e-3 + random.exponential(0.02, 400), 1.5) for _ in range(64)]
    found = wind_bed.flux(frames, PATCH)
    assert found.value == pytest.approx(400 * 2e-8 * 1.5 / 2e-5)
    assert found.sd == pytest.approx(0.0, abs=1e-9)
    height = wind_bed.flux_height(frames, PATCH)
    # 25,600 grains: 1/sqrt(N) is 0.6 %; bins and the tail that is cut add a few percent
    assert height.value == pytest.approx(0.02, rel=0.08)


def test_the_error_of_a_mean_counts_that_neighbours_in_time_are_alike():
    random = np.random.default_rng(3)
    slow = np.repeat(random.normal(10.0, 1.0, 64), 16)  # 64 independent values
    found = wind_bed.blocked("flux", slow.tolist(), "kg m-1 s-1")
    assert found.sd == pytest.approx(1.0 / 8.0, rel=0.6)
    drifting = wind_bed.blocked("flux", np.linspace(1.0, 2.0, 64).tolist(), "kg m-1 s-1")
    assert [each.flag for each in drifting.shortfalls] == ["drift"]
    assert wind_bed.blocked("flux", [1.0] * 5, "kg m-1 s-1").n == 0


def test_stresses_at_the_bed_are_those_of_the_profile():
    """Air without eddies under one stress, from which grains take 30 Pa m-1 below 2 mm."""
    face = np.linspace(0.0, 4e-3, 41)
    centre, nought = 0.5 * (face[1:] + face[:-1]), np.zeros(40)
    velocity = np.column_stack([0.05 / (1.2 * 1.5e-5) * centre, nought])
    drag = np.column_stack([np.where(centre < 2e-3, -30.0, 0.0), nought])
    airs = [AirProfile(face, velocity, np.ones(40), nought, drag, nought)] * 16
    assert wind_bed.bed_stress(airs, PATCH).value == pytest.approx(0.05)
    # the drag reaches to 2 mm, and only what lies a diameter of 0.25 mm over the bed of 1 mm counts
    assert wind_bed.grain_stress(airs, PATCH).value == pytest.approx(30.0 * 0.75e-3)
