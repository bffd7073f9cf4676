"""Mass flow through a plane: a known rate, its steady part, both directions, a period, lost grains."""

import numpy as np
import pytest

from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.mass_flow import mass_flow_rate, net_mass_through_plane, steady_frame_range
from tests.measures.heaps import snapshot_of

DOWN, PLANE, OPEN = (0.0, 0.0, -1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
MASS, SPEED, EVERY = 2e-6, 0.5, 0.01


def snapshot(time, position, velocity) -> Snapshot:
    return snapshot_of(position, time=time, velocity=velocity, mass=np.full(len(position), MASS))


def stream(crossings: np.ndarray, times: np.ndarray) -> list[Snapshot]:
    """Grains that fall at one speed and cross z = 0 at given times."""
    velocity = np.tile([0.0, 0.0, -SPEED], (len(crossings), 1))
    return [snapshot(t, np.outer(SPEED * (crossings - t), [0.0, 0.0, 1.0]), velocity) for t in times]


@pytest.fixture(scope="module")
def hopper() -> list[Snapshot]:
    """1,000 grains a second from 0.5 to 2.5 s, after a slow beginning, then a tail and one late grain."""
    rng = np.random.default_rng(2)
    begin, tail = 0.5 * np.sqrt(rng.uniform(size=120)), 2.5 + 0.4 * rng.uniform(size=100) ** 2
    steady = rng.uniform(0.5, 2.5, 2000)
    return stream(np.concatenate([begin, steady, tail, [5.0]]), np.arange(0.0, 6.0, EVERY))


def test_the_rate_of_the_steady_part_is_found_with_its_error(hopper):
    found = mass_flow_rate(hopper, PLANE, DOWN)
    begin, end = found.details["steady"]
    assert 0.3 < begin < 0.8
    assert 2.2 < end < 2.7
    assert found.value == pytest.approx(1000.0 * MASS, abs=3.0 * found.sd)
    assert found.sd < 0.05 * found.value
    assert sum(found.details["rate"]) * EVERY == pytest.approx(2221 * MASS)  # all mass is counted
    assert mass_flow_rate(hopper, PLANE, (0.0, 0.0, 2.0)).value == pytest.approx(-found.value)


@pytest.mark.parametrize(("end", "flags"), [(0.95, []), (0.5, ["drift"]), (4.0, ["drift"])])
def test_a_flow_that_drifts_says_so_and_a_steady_one_does_not(end, flags):
    share = np.random.default_rng(1).uniform(size=4000)  # of the mass, at a rate that goes from 1 to `end`
    times = 4.0 * (np.sqrt(1.0 + (end**2 - 1.0) * share) - 1.0) / (end - 1.0)
    flow = mass_flow_rate(stream(times, np.arange(0.0, 4.0, 0.02)), PLANE, DOWN)
    assert [lack.flag for lack in flow.shortfalls] == flags


def test_a_plane_that_nothing_crosses_has_no_flow(hopper):
    found = mass_flow_rate(hopper, (0.0, 0.0, 50.0), DOWN)
    assert np.isnan(found.value)
    assert found.notes == ("no grain crossed the plane",)
    (few,) = mass_flow_rate(hopper[:1], PLANE, DOWN).notes
    assert few.startswith("1 frames")


def test_back_and_forth_cancels_and_a_period_counts_once():
    places = np.array([[0.0, 0.0, 0.001], [0.0, 0.0, -0.001], [0.099, 0.0, 1.0]])
    later = np.array([[0.0, 0.0, -0.001], [0.0, 0.0, 0.001], [0.001, 0.0, 1.0]])  # the last went 0.002 m on
    pair = snapshot(0.0, places, 0.0 * places), snapshot(EVERY, later, 0.0 * places)
    assert net_mass_through_plane(*pair, np.zeros(3), np.array(DOWN), np.zeros(3)) == (0.0, 2, 0)
    around = net_mass_through_plane(*pair, np.zeros(3), np.array([1.0, 0.0, 0.0]), np.array([0.1, 0.0, 0.0]))
    assert around == pytest.approx((MASS, 1, 0))


def test_a_grain_that_is_taken_out_behind_the_plane_is_counted_by_its_speed():
    place, speed = np.array([[0.0, 0.0, 0.001], [0.0, 0.0, 0.2]]), np.array([[0.0, 0.0, -SPEED]] * 2)
    before = snapshot(0.0, place, speed)
    after = snapshot(EVERY, place[:0], speed[:0])
    assert net_mass_through_plane(before, after, np.zeros(3), np.array(DOWN), np.zeros(3)) == (MASS, 1, 1)


def test_zeros_behind_the_flow_are_no_steady_part():
    rate = np.concatenate([np.random.default_rng(3).normal(10.0, 3.0, 40), np.zeros(400), [10.0]])
    first, last = steady_frame_range(rate)
    assert last - first >= 25
    assert last <= 45


def test_a_flow_that_goes_to_and_fro_has_a_mean_of_zero():
    assert steady_frame_range(np.array([1.0, -1.0] * 20))[1] <= 40
