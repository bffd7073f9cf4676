"""Order of grains: width and order of their cells, partitions of equal cost, and forces that cancel."""

import numpy as np
import pytest
from grain_worlds import NONE, RADIUS, contacts, grains, heap, setup

from taichi_erosion.core.setup import Floats, Laws, Numerics
from taichi_erosion.core.transfer import download_field
from taichi_erosion.grains import partition
from taichi_erosion.grains.neighbour_list import ENGAGED
from taichi_erosion.simulation import advance, assemble, capacities, export_state, snapshot
from taichi_erosion.simulation.control import request_rebuild_and_wake

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
LAWS = Laws(rolling="elastic_plastic")
ALONE = 20.0  # m from the others
ROD = 40  # grains along a rod
STEPS = 10  # while grains touch; no rebuild between them mends the lists
ROUNDING = {"f32": 1e-6, "f64": 1e-14}  # of velocities, over their changes by some steps [1]
GRAINS, FALLEN = 120, 0.02  # of a heap, and the time [s] in which it has fallen half together


@pytest.mark.slow
def test_a_grain_far_from_all_others_does_not_widen_the_cells_of_the_crowd():
    rng = np.random.default_rng(1)
    sites = np.array(list(np.ndindex(16, 16, 16)))
    crowd = 2.2 * RADIUS * sites + rng.uniform(-0.01, 0.01, sites.shape) * RADIUS
    scene = setup(grains([*crowd, (ALONE, 0.0, 0.0)]), NONE)
    sim = assemble([scene], LAWS, Numerics("cpu", 1))
    advance(sim, [scene.time_step])
    width = 1.0 / download_field(sim.world.cells.inverse_width)[0]
    least = download_field(sim.world.cells.width_least)[0]
    # of 4,097 grains it is the one that adds to the sd a 64th of its distance
    assert width.max() < 1.5 * least


@pytest.mark.parametrize(
    ("axis", "numerics"),
    [
        (0, Numerics("cpu", 1)),
        *(pytest.param(k, Numerics("cpu", 1), marks=pytest.mark.slow) for k in (1, 2)),
        pytest.param(0, Numerics("cpu", 2, "f64", "grains"), marks=pytest.mark.slow),
    ],
)
def test_grains_are_sorted_along_the_longest_side_across_its_period(monkeypatch, axis, numerics):
    monkeypatch.setattr(capacities, "PARTITION_GRAINS", 16 * ROD // 4)
    # stirred grains overlap a little in a rod whose ends touch across the period
    rng = np.random.default_rng(3)
    place = np.roll(rng.permutation(1.99 * RADIUS * (np.array(list(np.ndindex(ROD, 4, 4))) + 0.5)), axis, 1)
    table = grains(place, rng.normal(0.0, 0.02, place.shape), rng.normal(0.0, 9.0, place.shape))
    period = np.roll((1.99 * RADIUS * ROD, 0.0, 0.0), axis)
    box = ((0.0, 0.0, 0.0), tuple(np.maximum(period, 10.0 * RADIUS)))
    weightless = {"gravity": (0.0, 0.0, 0.0), "period": tuple(period), "domain": box}
    scene = setup(table, NONE, contacts(rolling=0.1), **weightless)
    sim = assemble([scene], LAWS, numerics)
    advance(sim, [STEPS * scene.time_step])
    where = export_state(sim)["replica0_origin"][:, axis]
    width = 1.0 / download_field(sim.world.cells.inverse_width)[0][axis]
    end = snapshot(sim, 0)
    assert np.all(np.diff(where) > -width)
    # the first and the last of four parts touch across the period
    change = end.velocity - table.velocity[end.ident]
    imbalance = np.linalg.norm(change.sum(axis=0)) / np.linalg.norm(change, axis=1).sum()
    assert imbalance < ROUNDING[numerics.precision]


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
    request_rebuild_and_wake(sim, 0)
    advance(sim, [FALLEN + sim.setups[0].time_step])
    after = export_state(sim)
    spent = dict(zip(before["replica0_ident"].astype(int), costs(before), strict=True))
    ordered = np.array([spent[ident] for ident in after["replica0_ident"].astype(int)])
    cut = int(after["replica0_bounds"][1])
    assert after["replica0_bounds"][2] == GRAINS
    # the bound cannot lie closer to the middle of the cost than one grain
    assert abs(ordered[:cut].sum() - ordered[cut:].sum()) <= 2.0 * ordered.max()
    # the heap is denser below, where the order begins: fewer grains there cost as much as more above
    assert abs(cut - GRAINS // 2) > 2
