"""Which runs go together, and the share of their work that is done: never taken back."""

from collections import defaultdict
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
import stand_in

from taichi_erosion.campaign import execute as execution
from taichi_erosion.campaign.execute import WORK_MOST, WorkDone, next_batch, pace
from taichi_erosion.campaign.ledger import close_ledger, open_ledger, unfinished
from taichi_erosion.campaign.pool import Pool, start_pool
from taichi_erosion.campaign.request import RUNS_MOST, START, WORTH_A_START, RunRequest
from taichi_erosion.cli.progress import Countdown
from taichi_erosion.core.device import has_cuda
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Arch

WORKERS = 2


def requests(count: int, work: float, group: str = "") -> list[RunRequest]:
    return [RunRequest(f"{group}{k}", {}, group, work) for k in range(count)]


def dealt(waiting: list[RunRequest], deaths: dict[str, int] | None = None) -> list[int]:
    """Sizes of the batches, in the order in which workers take them."""
    sizes, deaths = [], defaultdict(int, deaths or {})
    while waiting:
        batch = next_batch(waiting, deaths, WORKERS)
        waiting = [request for request in waiting if request not in batch]
        sizes.append(len(batch))
    return sizes


def test_batches_shrink_are_worth_a_start_have_a_limit_and_hold_one_group():
    assert dealt(requests(10, WORTH_A_START)) == [5, 3, 1, 1]
    assert dealt(requests(20, WORTH_A_START / 8)) == [10, 8, 2]
    assert dealt(requests(RUNS_MOST + 6, 1.0)) == [RUNS_MOST, 6]
    assert dealt([*requests(3, 1.0, "a"), *requests(2, 1.0, "b")]) == [3, 2]


def test_a_batch_is_no_longer_than_a_killed_worker_may_lose():
    assert dealt(requests(4, WORK_MOST / 1.5)) == [1, 1, 1, 1]


@pytest.mark.parametrize("work", [1.0, WORTH_A_START])
def test_a_run_that_a_worker_died_of_goes_alone(work):
    assert dealt(requests(3, work), {"0": 1})[0] == 1


def test_a_graphics_processor_takes_all_that_it_has_room_for():
    long = [RunRequest(str(k), {}, "", WORK_MOST, most=6, arch="vulkan") for k in range(15)]
    sizes = []
    while long:
        batch = next_batch(long, defaultdict(int), 1)
        long = long[len(batch) :]
        sizes.append(len(batch))
    assert sizes == [6, 6, 3]


def on_device(folder: Path, arch: Arch) -> list[RunRequest]:
    return [replace(each, arch=arch) for each in stand_in.requests(folder, count=4, pause=0.0)]


def test_one_worker_holds_the_device(tmp_path, monkeypatch):
    started, looked = [], []

    def start(function: str, folder: Path, workers: int) -> Pool:
        started.append(workers)
        return start_pool(function, folder, workers)

    monkeypatch.setattr(execution, "start_pool", start)
    monkeypatch.setattr(execution, "refuse_missing_devices", looked.append)
    ledger = open_ledger(tmp_path)
    found = execution.execute(on_device(tmp_path, "vulkan"), ledger, workers=2, function=stand_in.FUNCTION)
    close_ledger(ledger)
    assert [result.failure for result in found] == [None] * 4
    assert (started, looked) == ([1], [{"vulkan"}])


def test_a_missing_device_is_told_before_any_run_counts_as_failed(tmp_path):
    if has_cuda():
        pytest.skip("there is such a device")
    ledger = open_ledger(tmp_path)
    with pytest.raises(BadInput, match="--arch cuda: no such device"):
        execution.execute(on_device(tmp_path, "cuda"), ledger, function=stand_in.FUNCTION)
    assert len(unfinished(ledger, [f"scene-{seed}" for seed in range(4)])) == 4
    close_ledger(ledger)


USUAL = START / WORTH_A_START  # s per grain-step


def test_the_pace_is_that_of_the_runs_that_have_ended_each_by_its_own_work():
    runs = {name: RunRequest(name, {}, work=work) for name, work in (("small", 1e8), ("large", 1e9))}
    assert pace(runs, {}) == USUAL
    assert pace(runs, {"small": 40.0}) == 4e-7
    assert pace(runs, {"small": 40.0, "large": 180.0}) == pytest.approx(2e-7)


def estimates(actual: float, batches: int, monkeypatch) -> list[tuple[float, float, float]]:
    """Times, shares and remaining times of a campaign whose runs take `actual` times the usual pace."""
    now = [0.0]
    monkeypatch.setattr(execution.time, "monotonic", lambda: now[0])
    wanted = {f"{k} {i}": RunRequest(f"{k} {i}", {}, work=1e8) for k in range(batches) for i in range(10)}
    done, countdown = WorkDone(wanted, 1e9 * batches), Countdown(0.0)
    left, ended, found = list(wanted), {}, []
    for k in range(batches):
        batch = [key for key in left if key.startswith(f"{k} ")]
        done.begin(batch)
        took = START + actual * USUAL * 1e9
        for _ in range(int(took)):
            now[0] += 1.0
            share = done.share(left, ended)
            seconds = countdown.seconds(share, now[0])
            found += [] if seconds is None else [(now[0], share, seconds)]
        now[0] += took % 1.0
        for key in batch:
            ended[key] = took / len(batch)
            left.remove(key)
    assert done.share(left, ended) == 1.0
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
