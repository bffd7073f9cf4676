"""Cells: width, order of the axes, and completeness of the neighbour search."""

import numpy as np
import pytest
from grain_worlds import NONE, RADIUS, grains, setup

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Floats, Laws, Numerics
from taichi_erosion.core.transfer import read
from taichi_erosion.simulation import advance, assemble, capacities, export_state, snapshot

LAWS = Laws(rolling="elastic_plastic")
ALONE = 20.0  # m from the others
ROD = 40  # grains along a rod


@pytest.mark.slow
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


@pytest.mark.parametrize("axis", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
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
    velocity = snapshot(sim, 0).velocity
    stop_device()
    assert np.all(np.diff(where) > -width)
    # the first and the last of four parts touch across the period
    assert np.linalg.norm(velocity.sum(axis=0)) < 1e-6 * np.linalg.norm(velocity, axis=1).sum()


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
