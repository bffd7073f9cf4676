"""Pairs in the void, periodic boxes, release, and worlds that come to a bad end beside others that go on."""

from math import isnan

import numpy as np
import pytest
from few_grains import INTERVAL, INTERVALS, PERIOD
from grain_worlds import GRAVITY, TIME_STEP

from taichi_erosion.core.snapshot import Status


def test_grains_enter_at_their_time_and_fall_from_there(records):
    record = records["released"]
    release = record.setup.grains.release_time
    for frame in record.frames:
        inside = release <= frame.time - TIME_STEP
        assert frame.ident.tolist() == np.flatnonzero(inside).tolist()
        assert frame.waiting == (~inside).sum()
    last = record.frames[-1]
    time = last.time - release
    # a late grain takes its first kick over a whole step, g dt t / 2 too far
    fallen = record.setup.grains.position[:, 2] - last.position[:, 2]
    assert fallen == pytest.approx(0.5 * GRAVITY * time**2, abs=GRAVITY * TIME_STEP * time.max())


def test_a_grain_meets_its_partner_across_the_edge_of_a_periodic_box(records):
    edge, middle = records["across the edge"].frames, records["in the middle"].frames
    assert np.linalg.norm(edge[-1].velocity - edge[0].velocity) > 0.05  # they have met
    for frame, other in zip(edge, middle, strict=True):
        assert frame.velocity == pytest.approx(other.velocity, abs=1e-9)


def test_positions_stay_inside_the_period(records):
    places = np.stack([frame.position[:, 0] for frame in records["across the edge"].frames])
    assert places.min() >= 0.0
    assert places.max() < PERIOD
    assert np.abs(np.diff(places, axis=0)).max() > 0.5 * PERIOD  # one of them went through the edge


@pytest.mark.parametrize(
    ("world", "status"),
    [
        ("runaway", Status.LOST),
        ("inside each other", Status.OVERLAP),
        ("not a number", Status.NOT_FINITE),
        ("infinite", Status.NOT_FINITE),
    ],
)
def test_a_world_that_goes_wrong_stops_and_says_why(records, world, status):
    end = records[world].failure
    assert end.status == status
    assert end.grain in (0, 1)
    assert records[world].frames[-1].time < INTERVALS * INTERVAL


def test_the_failure_names_grain_partner_and_size(records):
    overlap, lost = records["inside each other"].failure, records["runaway"].failure
    assert {overlap.grain, overlap.partner} == {0, 1}
    assert overlap.value == pytest.approx(0.8, abs=1e-3)  # 2 R - 1.2 R, over R, before anything has moved
    assert (lost.grain, lost.partner) == (0, -1)
    assert lost.value > 2e-3
    assert isnan(records["not a number"].failure.value)


def test_the_worlds_beside_a_stopped_one_go_on(records):
    for name in ("plane", "pair", "released", "drum"):
        assert records[name].failure is None
        assert records[name].frames[-1].time == pytest.approx(INTERVALS * INTERVAL, rel=1e-12)
