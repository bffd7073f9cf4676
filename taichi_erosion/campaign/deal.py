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
    done = np.cumsum([request.work for request in fellows])
    enough = int(np.searchsorted(done, WORTH_A_START)) + 1
    batch = fellows[: min(max(share, enough), RUNS_MOST)]
    while len(batch) > 1 and sum(request.work for request in batch) > WORK_MOST:
        batch.pop()
    return batch
