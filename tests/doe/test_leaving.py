"""Grains that leave their pockets: departures, returns and the criterion, counted on paths that are known."""

from math import isnan

import numpy as np

from doe.fluid_threshold.leaving import QUIET, Asked, Follower, departing, leaving_table

D = 1.0
PERIOD = np.array([10.0, 10.0])


def follower(count: int = 3) -> Follower:
    return Follower(np.zeros((count, 3)), PERIOD, D)


def test_a_grain_that_leaves_and_rests_again_is_counted_once_each():
    seen = follower()
    path = np.zeros((3, 3))
    path[0, 0] = 0.6
    seen.see(path.copy(), 0.1)
    for sample in range(QUIET):
        assert seen.rested == 0
        seen.see(path.copy(), 0.2 + 0.1 * sample)
    assert (seen.departures, seen.rested) == ([0.1], 1)
    # its place is a new one: half a diameter more is another departure
    path[0, 0] = 1.0
    seen.see(path.copy(), 5.0)
    assert len(seen.departures) == 1
    path[0, 0] = 1.2
    seen.see(path.copy(), 6.0)
    assert seen.departures == [0.1, 6.0]


def test_a_grain_across_the_period_has_not_left():
    seen = Follower(np.array([[9.9, 0.0, 0.0]]), PERIOD, D)
    seen.see(np.array([[0.1, 0.0, 0.0]]), 0.1)
    assert seen.departures == []


def test_two_grains_that_rise_by_a_diameter_meet_the_criterion():
    seen = follower()
    for time, risen in ((0.1, 0), (0.2, 1), (0.3, 2), (0.4, 3)):
        path = np.zeros((3, 3))
        path[:risen, 2] = 1.01
        seen.see(path, time)
    assert seen.criterion == 0.3
    row = seen.row(Asked(1, 1.0, 0.3), 0.4, ("1", "0000000"))
    assert (row.left, row.first, row.second, row.risen) == (3, 0.2, 0.3, 3)


def test_winds_without_departures_have_no_times():
    row = follower().row(Asked(1, 0.7, 0.2), 1.5, ("0.7", "0000000"))
    assert isnan(row.first)
    assert isnan(row.criterion)
    table = leaving_table([row]).splitlines()[-1]
    assert [cell.strip() for cell in table.split("|")[1:-1]] == ["0.7", "0 of 1", "0", "0 of 0"] + [
        "none"
    ] * 3


def test_a_bed_starts_between_the_winds_in_which_one_grain_and_two_leave():
    rows = []
    for wind, count in ((0.3, 2), (0.1, 0), (0.2, 1), (0.4, 1)):
        seen = follower()
        path = np.zeros((3, 3))
        path[:count, 0] = 0.6
        seen.see(path, 0.1)
        rows.append(seen.row(Asked(1, 1.0, wind), 1.5, ("1", "0000000")))
    (bed,) = departing(rows)
    assert (bed.low, bed.high) == (0.2, 0.3)
