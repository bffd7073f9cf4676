"""Workers and teams: who runs which replica, and how the members of a team wait for each other.

On a CPU one task is one worker thread. Where there are two workers or more for every replica, they form
teams and share its partitions; elsewhere a worker runs replicas by itself, in the turns that the host deals.
Partitions and their order of summation are properties of the replica, so the result is the same.
"""

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.state import MEETING

CPU_CHUNK = 512  # Taichi hands out CPU iterations in blocks of this size: one worker needs a whole block


@ti.func
def wait_for_team(replicas_out: ti.template(), r, size, turn):
    """Wait until all `size` members have come here; returns the number of the next meeting."""
    if size > 1:
        ti.atomic_add(replicas_out.arrivals[r, MEETING], 1)
        # an atomic read: a plain one may be hoisted out of the loop
        while ti.atomic_add(replicas_out.arrivals[r, MEETING], 0) < turn * size:
            pass
    return turn + 1


@ti.func
def is_mine(replicas: ti.template(), r, p, member, size):
    """Whether partition p belongs to a member; members own runs of neighbouring partitions."""
    return p * size // replicas.partitions[r] == member
