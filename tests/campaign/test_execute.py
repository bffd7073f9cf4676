"""Which runs go together, and the share of their work that is done: never taken back."""

from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import pytest
import stand_in
from stand_in import carry_out, opened

from taichi_erosion.campaign import execute as execution
from taichi_erosion.campaign.execute import WORK_MOST, next_batch, seconds_per_work
from taichi_erosion.campaign.ledger import unfinished_runs
from taichi_erosion.campaign.pool import Pool, start_pool
from taichi_erosion.campaign.request import RUNS_MOST, START, WORTH_A_START, RunRequest
from taichi_erosion.core.device import has_cuda
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Arch


def requests(count: int, work: float, group: str = "") -> list[RunRequest]:
    return [RunRequest(f"{group}{k}", {}, group, work) for k in range(count)]


def deal(waiting: list[RunRequest], deaths: dict[str, int] | None = None, workers=2) -> list[int]:
    """Sizes of the batches, in the order in which workers take them."""
    sizes, deaths = [], defaultdict(int, deaths or {})
    while waiting:
        batch = next_batch(waiting, deaths, workers)
        waiting = [request for request in waiting if request not in batch]
        sizes.append(len(batch))
    return sizes


def test_batches_shrink_are_worth_a_start_have_a_limit_and_hold_one_group():
    assert deal(requests(10, WORTH_A_START)) == [5, 3, 1, 1]
    assert deal(requests(20, WORTH_A_START / 8)) == [10, 8, 2]
    assert deal(requests(RUNS_MOST + 6, 1.0)) == [RUNS_MOST, 6]
    assert deal([*requests(3, 1.0, "a"), *requests(2, 1.0, "b")]) == [3, 2]
    assert deal(requests(4, WORK_MOST / 1.5)) == [1] * 4  # no longer than a killed worker may lose
    most = [replace(each, most=6, arch="cuda") for each in requests(15, WORK_MOST)]
    assert deal(most, workers=1) == [6, 6, 3]  # a graphics processor takes all that it has room for
    assert deal(requests(3, 1.0), {"0": 1})[0] == 1  # a worker died of it: it goes alone


def on_device(folder: Path, arch: Arch) -> list[RunRequest]:
    return [replace(each, arch=arch) for each in stand_in.requests(folder, count=4, pause=0.0)]


def test_one_worker_holds_the_device(tmp_path, monkeypatch):
    started, looked = [], []

    def start(function: str, folder: Path, workers: int) -> Pool:
        started.append(workers)
        return start_pool(function, folder, workers)

    monkeypatch.setattr(execution.pools, "start_pool", start)
    monkeypatch.setattr(execution.pools, "refuse_missing_devices", looked.append)
    assert [result.failure for result in carry_out(tmp_path, on_device(tmp_path, "cuda"))] == [None] * 4
    assert (started, looked) == ([1], [{"cuda"}])


@pytest.mark.skipif(has_cuda(), reason="there is such a device")
def test_a_missing_device_is_told_before_any_run_counts_as_failed(tmp_path):
    listed = on_device(tmp_path, "cuda")
    with opened(tmp_path) as ledger:
        with pytest.raises(BadInput, match="--arch cuda: no such device"):
            execution.run_requests(listed, ledger, function=stand_in.FUNCTION)
        assert len(unfinished_runs(ledger, [request.key for request in listed])) == 4


def test_the_pace_is_that_of_the_runs_that_have_ended_each_by_its_own_work():
    runs = {name: RunRequest(name, {}, work=work) for name, work in (("small", 1e8), ("large", 1e9))}
    assert seconds_per_work(runs, {}) == START / WORTH_A_START  # s per grain-step
    assert seconds_per_work(runs, {"small": 40.0}) == 4e-7
    assert seconds_per_work(runs, {"small": 40.0, "large": 180.0}) == pytest.approx(2e-7)
