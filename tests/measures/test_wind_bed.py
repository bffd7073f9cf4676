"""Flux, its height and the stresses at the bed of made-up transport."""

import numpy as np
import pytest

from taichi_erosion.core.snapshot import AirProfile, Snapshot
from taichi_erosion.measures import wind_bed
from tests.measures.heaps import snapshot_of

PATCH = wind_bed.Patch(area=2e-5, surface=1e-3, diameter=2.5e-4, density=1.2, viscosity=1.5e-5)
HUMP = [1.18, 1.36, 1.47, 1.28, 1.24, 1.18, 1.08, 1.00]  # eighths of a second, as eight beds once had it
SWINGS = {"up and down": (1.2, 0.8), "down and up": (0.7, 1.3), "always above": (1.06,)}


def flying(height: np.ndarray, speed: float) -> Snapshot:
    place, mass = np.column_stack([np.zeros((len(height), 2)), height]), np.full(len(height), 2e-8)
    return snapshot_of(place, velocity=np.tile([speed, 0.0, 0.0], (len(height), 1)), mass=mass)


def test_flux_and_its_height_are_those_of_the_transport_that_was_made():
    random = np.random.default_rng(2)
    frames = [flying(1e-3 + random.exponential(0.02, 400), 1.5) for _ in range(64)]
    found = wind_bed.mean_sand_flux(frames, PATCH)
    assert (found.value, found.sd) == (pytest.approx(400 * 2e-8 * 1.5 / 2e-5), pytest.approx(0.0, abs=1e-9))
    height = wind_bed.flux_decay_height(frames, PATCH)
    # 25,600 grains: 1/sqrt(N) is 0.6 %; bins and the tail that is cut add a few percent
    assert height.value == pytest.approx(0.02, rel=0.08)


def test_the_error_of_a_mean_counts_that_neighbours_in_time_are_alike():
    slow = np.repeat(np.random.default_rng(3).normal(10.0, 1.0, 64), 16)  # 64 independent values
    assert wind_bed.mean_by_block("flux", slow.tolist(), "kg m-1 s-1").sd == pytest.approx(1.0 / 8.0, rel=0.6)
    drifting = wind_bed.mean_by_block("flux", np.linspace(1.0, 2.0, 64).tolist(), "kg m-1 s-1")
    assert [each.flag for each in drifting.shortfalls] == ["drift"]
    assert wind_bed.mean_by_block("flux", [1.0] * 5, "kg m-1 s-1").n == 0


def test_stresses_at_the_bed_are_those_of_the_profile():
    """Air without eddies under one stress, from which grains take 30 Pa m-1 below 2 mm."""
    face = np.linspace(0.0, 4e-3, 41)
    centre, nought = 0.5 * (face[1:] + face[:-1]), np.zeros(40)
    velocity = np.column_stack([0.05 / (1.2 * 1.5e-5) * centre, nought])
    drag = np.column_stack([np.where(centre < 2e-3, -30.0, 0.0), nought])
    airs = [AirProfile(face, velocity, np.ones(40), nought, drag, nought)] * 16
    assert wind_bed.mean_air_stress_at_bed(airs, PATCH).value == pytest.approx(0.05)
    # the drag reaches to 2 mm, and only what lies a diameter of 0.25 mm over the bed of 1 mm counts
    assert wind_bed.mean_grain_stress_at_bed(airs, PATCH).value == pytest.approx(30.0 * 0.75e-3)


def window_of(parts: list[float], seconds: float, noise: float = 0.0, beds: int = 2) -> wind_bed.Window:
    """Window of some beds whose shares go through `parts` in turn, at 200 frames a second."""
    count = round(200 * seconds)
    share = np.repeat(parts, -(-count // len(parts)))[:count]
    random = np.random.default_rng(4)
    shares = [share + noise * random.standard_normal(count) for _ in range(beds)]
    return wind_bed.steady_window((np.arange(1, count + 1) / 200).tolist(), shares, hop=0.05)


def test_a_hump_of_the_start_is_left_out_of_the_window():
    found = window_of([*HUMP, *[1.0] * 24], 4.0)
    assert not found.lacking
    assert 0.55 < found.start < 1.1  # the hump has a tail of a few percent
    assert found.balance == pytest.approx(1.0, abs=0.03)


def test_a_hump_alone_is_not_steady_and_blocks_a_comparison():
    (lacking,) = window_of(HUMP, 1.0).lacking
    assert lacking.flag == "unsteady"
    assert lacking.blocks
    (longer,) = window_of(HUMP, 2.0).lacking  # the same, slower: now long enough to be judged
    assert longer.needed == wind_bed.BALANCE
    assert longer.found > wind_bed.BALANCE


def test_a_stage_that_is_too_short_is_measured_whole_and_says_so():
    found = window_of([1.0], 0.4)  # of a dozen hops of 0.05 s
    assert (found.first, [each.needed for each in found.lacking]) == (0, [pytest.approx(0.6)])


@pytest.mark.parametrize("parts", SWINGS.values(), ids=SWINGS)
def test_momentum_that_comes_and_goes_does_not_pass_for_balance(parts):
    assert window_of(list(parts), 1.2).lacking


def test_scatter_of_beds_that_are_balanced_is_averaged_over_them():
    found = window_of([1.0], 2.0, noise=0.3, beds=8)  # a half has 1,600 values: 0.8 %
    assert (found.first, found.lacking) == (0, ())
