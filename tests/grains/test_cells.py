"""Cells: their width and the order of their axes."""

import numpy as np
import pytest
from grain_worlds import NONE, RADIUS, grains, setup

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Laws, Numerics
from taichi_erosion.core.transfer import read
from taichi_erosion.simulation import advance, assemble, capacities, export_state, snapshot

LAWS = Laws(rolling="elastic_plastic")
ALONE = 20.0  # m from the others
ROD = 40  # grains along a rod


@pytest.mark.slow
def test_a_grain_far_from_all_others_does_not_widen_the_cells_of_the_crowd():
    rng = np.random.default_rng(1)
    sites = np.array(list(np.ndindex(16, 16, 16)))
    crowd = 2.2 * RADIUS * sites + rng.uniform(-0.01, 0.01, sites.shape) * RADIUS
    scene = setup(grains([*crowd, (ALONE, 0.0, 0.0)]), NONE)
    sim = assemble([scene], LAWS, Numerics("cpu", 1))
    advance(sim, [scene.time_step])
    width = 1.0 / read(sim.world.cells.inverse_width)[0]
    least = read(sim.world.cells.width_least)[0]
    stop_device()
    # of 4,097 grains it is the one that adds to the sd a 64th of its distance
    assert width.max() < 1.5 * least


@pytest.mark.parametrize("axis", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
def test_grains_are_sorted_along_the_longest_side_and_forces_cancel_across_its_period(monkeypatch, axis):
    monkeypatch.setattr(capacities, "PARTITION_GRAINS", 16 * ROD // 4)
    # grains overlap a little in a rod whose ends touch across the period
    sites = 1.99 * RADIUS * (np.array(list(np.ndindex(ROD, 4, 4))) + 0.5)
    place = np.roll(np.random.default_rng(3).permutation(sites), axis, axis=1)
    period = np.roll((1.99 * RADIUS * ROD, 0.0, 0.0), axis)
    box = ((0.0, 0.0, 0.0), tuple(np.maximum(period, 10.0 * RADIUS)))
    scene = setup(grains(place), NONE, gravity=(0.0, 0.0, 0.0), period=tuple(period), domain=box)
    sim = assemble([scene], LAWS, Numerics("cpu", 1))
    advance(sim, [scene.time_step])
    where = export_state(sim)["replica0_origin"][:, axis]
    width = 1.0 / read(sim.world.cells.inverse_width)[0][axis]
    velocity = snapshot(sim, 0).velocity
    stop_device()
    assert np.all(np.diff(where) > -width)
    # the first and the last of four parts touch across the period
    assert np.linalg.norm(velocity.sum(axis=0)) < 1e-6 * np.linalg.norm(velocity, axis=1).sum()
