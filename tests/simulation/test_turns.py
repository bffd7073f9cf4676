"""Schedules that deal the steps of replicas to workers."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from taichi_erosion.simulation.schedule import Deal, deal_turns

steps_of_replicas = st.lists(st.integers(0, 5000), min_size=1, max_size=12)
workers_present = st.integers(1, 8)


def parts(deal: Deal) -> list[list[tuple[int, int, int]]]:
    """Replica, steps and order of every turn, worker by worker."""
    turns = list(zip(deal.replica, deal.steps, deal.order, strict=True))
    return [turns[low:high] for low, high in zip(deal.first[:-1], deal.first[1:], strict=True)]


@given(steps_of_replicas, workers_present)
def test_every_step_is_dealt_once(steps, workers):
    deal = deal_turns(np.array(steps, np.int32), workers)
    dealt = np.zeros(len(steps), int)
    np.add.at(dealt, np.array(deal.replica, int), deal.steps)
    assert dealt.tolist() == steps
    assert len(deal.replica) <= workers + len(steps)  # the room that the device has


@given(steps_of_replicas, workers_present)
def test_no_worker_meets_the_same_replica_twice(steps, workers):
    for part in parts(deal_turns(np.array(steps, np.int32), workers)):
        replicas = [replica for replica, _, _ in part]
        assert len(set(replicas)) == len(replicas)


@given(steps_of_replicas, workers_present)
def test_the_turns_of_a_replica_are_counted_from_nought(steps, workers):
    deal = deal_turns(np.array(steps, np.int32), workers)
    for replica in set(deal.replica):
        orders = [order for r, order in zip(deal.replica, deal.order, strict=True) if r == replica]
        assert sorted(orders) == list(range(len(orders)))


@given(steps_of_replicas, workers_present)
def test_no_schedule_could_end_sooner(steps, workers):
    # McNaughton: the longest replica, or the equal share of all; here workers wait as they do on the device
    deal = deal_turns(np.array(steps, np.int32), workers)
    ended: dict[tuple[int, int], int] = {}
    clocks, todo = [0] * workers, [list(part) for part in parts(deal)]
    while any(todo):
        before = sum(map(len, todo))
        for worker, turns in enumerate(todo):
            while turns and (turns[0][2] == 0 or (turns[0][0], 0) in ended):
                replica, count, order = turns.pop(0)
                begun = max(clocks[worker], ended.get((replica, order - 1), 0))
                clocks[worker] = ended[replica, order] = begun + count
        assert sum(map(len, todo)) < before, "workers wait for each other"
    assert max(clocks) <= max(max(steps), -(-sum(steps) // workers))


def test_equal_replicas_share_the_workers_equally():
    deal = deal_turns(np.full(3, 1000, np.int32), 2)
    assert [sum(count for _, count, _ in part) for part in parts(deal)] == [1500, 1500]
