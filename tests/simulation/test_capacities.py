"""Room on the device: small scenes share one size, and so their kernels; what stays empty changes nothing."""

from dataclasses import replace

import numpy as np
import pytest
from grain_worlds import NONE, PLATE, RADIUS, ends, grains, setup

from taichi_erosion.core.setup import Laws, Numerics, PrimitiveTable, Setup
from taichi_erosion.core.ti import impl
from taichi_erosion.simulation import assemble, energies, export_state
from taichi_erosion.simulation.assemble import reallocate
from taichi_erosion.simulation.capacities import initial_capacities
from taichi_erosion.simulation.step import release_first

UNTIL = 2e-3  # s, in which a grain that starts a radius above the plate has hit it


def row(count: int, walls: PrimitiveTable = PLATE) -> Setup:
    """Grains side by side, a radius above the plate, that fall on it at 1 m/s."""
    place = np.zeros((count, 3))
    place[:, 0], place[:, 2] = 1.99 * RADIUS * np.arange(count), 2.0 * RADIUS
    return setup(grains(place, velocity=(0.0, 0.0, -1.0)), walls)


@pytest.mark.parametrize("walls", [NONE, PLATE])
@pytest.mark.parametrize(("count", "replicas"), [(1, 1), (2, 40), (33, 7), (128, 64)])
def test_small_scenes_of_any_kind_get_the_same_room(count, replicas, walls):
    assert initial_capacities([row(count, walls)] * replicas) == initial_capacities([row(5)])


def test_a_scene_of_many_grains_gets_room_for_its_own_replicas_only():
    sizes = initial_capacities([row(200)] * 3)
    assert (sizes.replicas, sizes.primitives, sizes.surfaces) == (3, 1, 1)


@pytest.mark.slow
def test_room_that_stays_empty_changes_no_bit_of_a_result():
    setups = [row(2), row(3)]
    sim = assemble(setups, Laws(rolling="elastic_plastic"), Numerics("cpu", 1))
    start = export_state(sim)
    roomy = ends(sim, UNTIL)
    reallocate(sim, replace(sim.capacities, replicas=2, grains=3, primitives=1, surfaces=1))
    release_first(sim.world)
    assert export_state(sim)["released"].tolist() == start["released"].tolist()
    assert ends(sim, UNTIL) == roomy
    assert energies(sim).shape[0] == 2


def test_one_worker_and_two_are_given_the_same_kernels():
    kinds = set()
    for threads in (1, 2):
        sim = assemble([row(2)], Laws(), Numerics("cpu", threads))
        assert sim.workers == threads
        room = sim.schedule.first.shape, sim.schedule.steps.shape
        kinds.add((impl.current_cfg().cpu_max_num_threads, *room))
    assert len(kinds) == 1
