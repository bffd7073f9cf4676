"""Sharing grains among partitions, and the cells in which their partners are sought."""

import numpy as np
import pytest
from grain_worlds import NONE, RADIUS, grains, heap, setup

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Floats, Laws, Numerics
from taichi_erosion.core.transfer import read
from taichi_erosion.grains import partition
from taichi_erosion.grains.neighbour_list import ENGAGED
from taichi_erosion.simulation import advance, assemble, capacities, export_state, force_imbalance
from taichi_erosion.simulation.control import make_stale

LAWS = Laws(rolling="elastic_plastic")
GRAINS = 120
FALLEN = 0.02  # s, in which the heap has fallen half together
ALONE = 20.0  # m from the others
ROD = 40  # grains along a rod


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


def test_a_grain_far_from_all_others_does_not_widen_the_cells_of_the_crowd():
    rng = np.random.default_rng(1)
    sites = np.stack(np.meshgrid(*[np.arange(16)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    crowd = 2.2 * RADIUS * sites + rng.uniform(-0.01, 0.01, sites.shape) * RADIUS
    scene = setup(grains([*crowd, (ALONE, 0.0, 0.0)]), NONE)
    sim = assemble([scene], LAWS, Numerics("cpu", 1))
    advance(sim, [scene.time_step])
    width = 1.0 / read(sim.world.cells.inverse_width)[0]
    least = read(sim.world.cells.width_least)[0]
    stop_device()
    # of 4,097 grains it is the one that adds to the sd a 64th of its distance
    assert width.max() < 1.5 * least


def rod() -> Floats:
    """Places of grains that overlap a little, in a rod along x; its ends touch across the period."""
    sites = np.stack(np.meshgrid(np.arange(ROD), *[np.arange(4)] * 2, indexing="ij"), axis=-1).reshape(-1, 3)
    return 1.99 * RADIUS * (sites + 0.5)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_grains_are_sorted_along_the_longest_side_and_forces_cancel_across_its_period(monkeypatch, axis):
    monkeypatch.setattr(capacities, "PARTITION_GRAINS", 16 * ROD // 4)
    place = np.roll(np.random.default_rng(3).permutation(rod()), axis, axis=1)
    period = np.roll((1.99 * RADIUS * ROD, 0.0, 0.0), axis)
    box = ((0.0, 0.0, 0.0), tuple(np.maximum(period, 10.0 * RADIUS)))
    scene = setup(grains(place), NONE, gravity=(0.0, 0.0, 0.0), period=tuple(period), domain=box)
    sim = assemble([scene], LAWS, Numerics("cpu", 1))
    advance(sim, [scene.time_step])
    where = export_state(sim)["replica0_origin"][:, axis]
    width = 1.0 / read(sim.world.cells.inverse_width)[0][axis]
    astray = force_imbalance(sim, 0)
    stop_device()
    assert np.all(np.diff(where) > -width)
    # the first and the last of four parts touch across the period
    assert astray < 1e-6


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_no_pair_that_touches_is_missing_from_the_list(speed):
    """Against all pairs by distance, in a cloud that has spread from where the scene put it."""
    rng = np.random.default_rng(2)
    place = rng.uniform(0.0, 30.0 * RADIUS, (400, 3))
    scene = setup(grains(place, speed * rng.normal(size=place.shape)), NONE, gravity=(0.0, 0.0, 0.0))
    sim = assemble([scene], LAWS, Numerics("cpu", 1))
    advance(sim, [2e-3])
    state = export_state(sim)
    stop_device()
    where = state["replica0_origin"] + state["replica0_shift"]
    apart = np.linalg.norm(where[:, None] - where[None], axis=-1)
    first, second = np.nonzero(np.triu(apart < 2.0 * RADIUS, 1))
    number = state["replica0_pair_number"].astype(int)
    listed = zip(
        np.repeat(np.arange(len(number)), number), state["replica0_pair_neighbour"].astype(int), strict=True
    )
    assert len(first) > 20
    assert set(zip(first, second, strict=True)) <= {(min(pair), max(pair)) for pair in listed}
