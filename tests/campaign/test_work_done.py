"""Share of a campaign's work: known early, refined by runs that end, never taken back."""

from itertools import pairwise

import numpy as np
import pytest

from taichi_erosion.campaign import work_done
from taichi_erosion.campaign.request import START, WORTH_A_START, RunRequest
from taichi_erosion.campaign.work_done import GUESSED, KNOWN, WorkDone, pace, share_by_time
from taichi_erosion.cli.progress import Countdown

USUAL = START / WORTH_A_START  # s per grain-step


@pytest.mark.parametrize(
    ("elapsed", "spread"), [(0.02, GUESSED), (0.3, GUESSED), (3.0, GUESSED), (1.2, KNOWN)]
)
def test_the_share_by_time_is_the_mean_over_possible_durations(elapsed: float, spread: float):
    durations = np.exp(spread * np.random.default_rng(1).standard_normal(2_000_000))
    longer = elapsed / durations[durations > elapsed]
    error = longer.std() / np.sqrt(longer.size)
    assert share_by_time(elapsed, spread) == pytest.approx(longer.mean(), abs=5.0 * error)


@pytest.mark.parametrize("spread", [GUESSED, KNOWN])
def test_the_share_by_time_grows_and_stays_below_the_whole(spread: float):
    shares = [share_by_time(each, spread) for each in np.geomspace(1e-3, 1e3, 200)]
    assert all(before <= after for before, after in pairwise(shares))
    assert 0.0 < shares[0] < 0.002
    assert shares[-1] < 1.0


def test_the_pace_is_that_of_the_runs_that_have_ended_each_by_its_own_work():
    runs = {name: RunRequest(name, {}, work=work) for name, work in (("small", 1e8), ("large", 1e9))}
    assert pace(runs, {}) == USUAL
    assert pace(runs, {"small": 40.0}) == 4e-7
    assert pace(runs, {"small": 40.0, "large": 180.0}) == pytest.approx(2e-7)


def estimates(actual: float, batches: int, monkeypatch) -> list[tuple[float, float, float]]:
    """Times, shares and remaining times of a campaign whose runs take `actual` times the usual pace."""
    now = [0.0]
    monkeypatch.setattr(work_done.time, "monotonic", lambda: now[0])
    wanted = {f"{k} {i}": RunRequest(f"{k} {i}", {}, work=1e8) for k in range(batches) for i in range(10)}
    done, countdown = WorkDone(wanted, 1e9 * batches, {}), Countdown(0.0)
    left, found = list(wanted), []
    for k in range(batches):
        batch = [key for key in left if key.startswith(f"{k} ")]
        done.begin(batch)
        took = START + actual * USUAL * 1e9
        for _ in range(int(took)):
            now[0] += 1.0
            share = done.share(left)
            seconds = countdown.seconds(share, now[0])
            found += [] if seconds is None else [(now[0], share, seconds)]
        now[0] += took % 1.0
        for key in batch:
            done.end(key, took / len(batch))
            left.remove(key)
    assert done.share(left) == 1.0
    return [(now[0] - at, share, seconds) for at, share, seconds in found]


@pytest.mark.parametrize("actual", [0.4, 1.0, 2.5])
def test_the_time_that_is_left_is_told_early_and_within_a_factor_where_limits_tell_nothing(
    actual: float, monkeypatch
):
    found = estimates(actual, 6, monkeypatch)
    assert found[0][1] < 0.02  # a share of the whole by which there is an estimate
    end = 0.05 * max(true for true, _, _ in found)  # where a part of the last batch is all that is left
    later = [(true, seconds) for true, share, seconds in found if share > 0.1 and true > end]
    for (_, before), (_, after) in pairwise(later):
        assert 0.5 <= after / before <= 2.0
    known = [(true, seconds) for true, share, seconds in found if share > 0.3 and true > end]
    assert all(0.5 < seconds / true < 2.0 for true, seconds in known)
