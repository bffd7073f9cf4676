"""Schedule: the steps of many replicas distributed over few workers, so that all workers finish together.

Replicas are laid end to end and the whole is cut into equal parts, one per worker; a replica that is cut is
begun by the next worker, at the start of its part, and ended by the earlier one, at the end of its part. That
is the shortest schedule with preemption.

Reference: McNaughton (1959), Management Science 6, 1.
"""

from typing import Any

import numpy as np

from taichi_erosion.core.setup import Integers
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record, upload


@device_record
class Schedule:
    """Tasks of all workers, worker by worker: fields on the device, or lists on the host."""

    first: Any  # by worker: first task, and one more bound
    replica: Any  # by task
    steps: Any  # by task
    order: Any  # by task: number of earlier tasks of the same replica


def allocate_schedule(workers: int, replicas: int) -> Schedule:
    """Fields for one schedule: every worker can cut one replica more."""
    tasks = workers + replicas
    sizes = (workers + 1, tasks, tasks, tasks)
    return Schedule(*(ti.field(ti.i32, size) for size in sizes))


def assign_steps_to_workers(steps: Integers, workers: int) -> Schedule:
    """Cut the steps of all replicas into equal parts; a part never contains the same replica twice."""
    if workers >= len(steps):
        everyone = list(range(len(steps)))
        first = [min(worker, len(steps)) for worker in range(workers + 1)]
        return Schedule(first, everyone, [int(n) for n in steps], [0] * len(steps))
    total = int(steps.sum())
    share = max(-(-total // workers), int(steps.max()), 1)
    bounds = np.concatenate([[0], np.cumsum(steps)])
    assignment = Schedule([0], [], [], [])
    for worker in range(workers):
        low, high = worker * share, min((worker + 1) * share, total)
        for r in np.flatnonzero((bounds[:-1] < high) & (bounds[1:] > low)):
            begin, end = max(low, int(bounds[r])), min(high, int(bounds[r + 1]))
            # a replica cut by the end of this part is begun by the next worker
            assignment.order.append(1 if bounds[r + 1] > high else 0)
            assignment.replica.append(int(r))
            assignment.steps.append(end - begin)
        assignment.first.append(len(assignment.replica))
    return assignment


def upload_schedule(schedule: Schedule, assignment: Schedule) -> None:
    upload([(schedule.first, assignment.first)])
    names = ("replica", "steps", "order")
    upload([(getattr(schedule, name), getattr(assignment, name)) for name in names])
