"""Which runs go together: long ones are shared among workers, short ones are not worth a start each."""

from collections import defaultdict

import pytest

from taichi_erosion.campaign.execute import WORK_MOST, next_batch
from taichi_erosion.campaign.request import RUNS_MOST, WORTH_A_START, RunRequest

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


def test_long_runs_are_dealt_in_ever_smaller_batches():
    assert dealt(requests(10, WORTH_A_START)) == [5, 3, 1, 1]


def test_short_runs_are_not_dealt_one_by_one():
    assert dealt(requests(20, WORTH_A_START / 8)) == [10, 8, 2]


def test_runs_of_next_to_nothing_go_together_but_not_without_end():
    assert dealt(requests(RUNS_MOST + 6, 1.0)) == [RUNS_MOST, 6]


def test_a_batch_is_no_longer_than_a_killed_worker_may_lose():
    assert dealt(requests(4, WORK_MOST / 1.5)) == [1, 1, 1, 1]


@pytest.mark.parametrize("work", [1.0, WORTH_A_START])
def test_a_run_that_a_worker_died_of_goes_alone(work):
    assert dealt(requests(3, work), {"0": 1})[0] == 1


def test_groups_are_not_mixed():
    assert dealt([*requests(3, 1.0, "a"), *requests(2, 1.0, "b")]) == [3, 2]
