"""Which runs go together as one batch.

A free worker takes 1/W of what is left of one group (guided self-scheduling): long batches first, where the
start of an ensemble costs little, short ones at the end, so that all workers finish together. A batch is not
larger than WORK_MOST, for that is what a killed worker loses, and holds enough to be worth its start.

Reference: Polychronopoulos & Kuck (1987), IEEE Trans. Comput. C-36, 1425.
"""

from collections.abc import Sequence

import numpy as np

from taichi_erosion.campaign.request import WORTH_A_START, RunRequest

WORK_MOST = 3e9  # grain-steps of a batch: about ten minutes of one core
RUNS_MOST = 64  # of a batch: more make an ensemble no cheaper to start, but its fields larger


def next_batch(waiting: Sequence[RunRequest], deaths: dict[str, int], workers: int) -> list[RunRequest]:
    """Runs for a free worker. A run that a worker has died of goes alone, so that it takes no other along."""
    first = waiting[0]
    if deaths[first.key]:
        return [first]
    fellows = [request for request in waiting if request.group == first.group and not deaths[request.key]]
    share = -(-len(fellows) // workers)
    work = np.cumsum([request.work for request in fellows])
    least = int(np.searchsorted(work, WORTH_A_START)) + 1
    most = int(np.searchsorted(work, WORK_MOST, side="right"))
    return fellows[: max(min(max(share, least), most, RUNS_MOST), 1)]
