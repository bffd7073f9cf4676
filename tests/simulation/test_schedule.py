"""Schedules that assign the steps of replicas to workers."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from taichi_erosion.simulation.schedule import Schedule, assign_steps_to_workers

steps_of_replicas = st.lists(st.integers(0, 5000), min_size=1, max_size=12)
workers_present = st.integers(1, 8)


def parts(assignment: Schedule) -> list[list[tuple[int, int, int]]]:
    """Replica, steps and order of every turn, worker by worker."""
    turns = list(zip(assignment.replica, assignment.steps, assignment.order, strict=True))
    return [turns[low:high] for low, high in zip(assignment.first[:-1], assignment.first[1:], strict=True)]


@given(steps_of_replicas, workers_present)
def test_every_step_is_assigned_once_and_no_worker_meets_a_replica_twice(steps, workers):
    assignment = assign_steps_to_workers(np.array(steps, np.int32), workers)
    assigned = np.zeros(len(steps), int)
    np.add.at(assigned, np.array(assignment.replica, int), assignment.steps)
    assert assigned.tolist() == steps
    assert len(assignment.replica) <= workers + len(steps)  # the room that the device has
    for part in parts(assignment):
        replicas = [replica for replica, _, _ in part]
        assert len(set(replicas)) == len(replicas)
    orders: dict[int, list[int]] = {}
    for replica, order in zip(assignment.replica, assignment.order, strict=True):
        orders.setdefault(replica, []).append(order)
    assert all(sorted(order) == list(range(len(order))) for order in orders.values())


@given(steps_of_replicas, workers_present)
def test_no_schedule_could_end_sooner(steps, workers):
    # McNaughton: the longest replica, or the equal share of all; here workers wait as they do on the device
    assignment = assign_steps_to_workers(np.array(steps, np.int32), workers)
    ended: dict[tuple[int, int], int] = {}
    clocks, todo = [0] * workers, [list(part) for part in parts(assignment)]
    while any(todo):
        before = sum(map(len, todo))
        for worker, turns in enumerate(todo):
            while turns and (turns[0][2] == 0 or (turns[0][0], 0) in ended):
                replica, count, order = turns.pop(0)
                begun = max(clocks[worker], ended.get((replica, order - 1), 0))
                clocks[worker] = ended[replica, order] = begun + count
        assert sum(map(len, todo)) < before, "workers wait for each other"
    assert max(clocks) <= max(max(steps), -(-sum(steps) // workers))
