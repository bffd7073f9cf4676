"""Partitions of a replica: grains divided by their cost."""

import numpy as np
from grain_worlds import heap

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Floats, Laws, Numerics
from taichi_erosion.grains import partition
from taichi_erosion.grains.neighbour_list import ENGAGED
from taichi_erosion.simulation import advance, assemble, capacities, export_state
from taichi_erosion.simulation.control import make_stale

LAWS = Laws(rolling="elastic_plastic")
GRAINS = 120
FALLEN = 0.02  # s, in which the heap has fallen half together


def costs(state: dict[str, Floats]) -> Floats:
    """What every grain of replica 0 costs by its lists, in the order of the grains."""
    total = np.full(len(state["replica0_pair_number"]), float(partition.GRAIN))
    kinds = (("pair", 1, partition.CONTACT), ("wall", partition.WALL, partition.WALL_CONTACT))
    for prefix, listed, touched in kinds:
        number = state[f"replica0_{prefix}_number"].astype(int)
        owner = np.repeat(np.arange(len(number)), number)
        acts = state[f"replica0_{prefix}_label"].astype(int) & ENGAGED
        total += np.bincount(owner, listed + touched * acts, minlength=len(total))
    return total


def test_partitions_take_as_long_as_each_other_where_they_hold_unequal_numbers_of_contacts(monkeypatch):
    monkeypatch.setattr(capacities, "PARTITION_GRAINS", GRAINS // 2)
    sim = assemble([heap(GRAINS, 1)], LAWS, Numerics("cpu", 1))
    advance(sim, [FALLEN])
    before = export_state(sim)
    make_stale(sim, 0)
    advance(sim, [FALLEN + sim.setups[0].time_step])
    after = export_state(sim)
    stop_device()
    spent = dict(zip(before["replica0_ident"].astype(int), costs(before), strict=True))
    ordered = np.array([spent[ident] for ident in after["replica0_ident"].astype(int)])
    cut = int(after["replica0_bounds"][1])
    assert after["replica0_bounds"][2] == GRAINS
    # the bound cannot lie closer to the middle of the cost than one grain
    assert abs(ordered[:cut].sum() - ordered[cut:].sum()) <= 2.0 * ordered.max()
    # the heap is denser below, where the order begins: fewer grains there cost as much as more above
    assert abs(cut - GRAINS // 2) > 2
