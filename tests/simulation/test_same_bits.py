"""A replica gives the same bits alone and in company, on one worker or two, resumed, after lists grew."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from grain_worlds import ends, fingerprint, heap

from taichi_erosion import simulation
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.simulation import capacities
from taichi_erosion.simulation.assemble import reallocate_fields

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
LAWS = Laws(rolling="elastic_plastic")
GRAINS = 120
HALF, WHOLE = 0.005, 0.01  # s
PAIRS_TOO_FEW = 160  # entries; the heap wants more than these and fewer than twice as many
WALL_PAIRS_TOO_FEW = 64
PAIRS_FAR_TOO_FEW = 80  # fewer than the heap holds half way


def run(setups: list[Setup], threads: int, until: float) -> list[str]:
    return ends(simulation.assemble(setups, LAWS, Numerics("cpu", threads)), until)


@pytest.fixture(scope="module")
def alone() -> SimpleNamespace:
    """One heap on one worker, half way and at the end, with its state and contacts half way; then others."""
    numerics, heaps = Numerics("cpu", 1), SimpleNamespace()
    sim = simulation.assemble([heap(GRAINS, 1)], LAWS, numerics)
    (heaps.half,) = ends(sim, HALF)
    heaps.state, heaps.contacts_then = simulation.export_state(sim), simulation.energy_totals(sim, 0).contacts
    (heaps.end,) = ends(sim, WHOLE)
    simulation.import_state(sim, heaps.state)
    heaps.back = fingerprint(simulation.snapshot(sim, 0))
    (heaps.again,) = ends(sim, WHOLE)
    one = heap(GRAINS, 1)
    # every other grain of a second material: of equal contacts, and of smoother ones
    equal = replace(one, grains=replace(one.grains, material=np.arange(GRAINS, dtype=np.int32) % 2))
    smooth = replace(equal, contacts=replace(one.contacts, friction_sliding=np.array([0.5, 0.1, 0.1])))
    others = simulation.reuse_or_assemble(sim, [one, equal, smooth], LAWS, numerics)
    assert others is sim  # kernels compile once
    heaps.one, *heaps.mixed = ends(others, WHOLE)
    return heaps


def test_a_run_put_back_to_an_earlier_state_repeats_itself(alone):
    assert alone.contacts_then > 10  # springs are stretched
    assert alone.back == alone.half
    assert alone.again == alone.end != alone.half


def test_neighbours_in_an_ensemble_and_a_second_worker_change_no_bit(alone):
    # three replicas on two workers: one of them is begun by one worker and ended by the other
    bits = run([heap(GRAINS // 2, 3, friction=0.1), heap(GRAINS, 1), heap(GRAINS, 2)], 2, WHOLE)
    assert bits[1] == alone.end
    assert bits[1] != bits[2], "heaps of different seeds"


def test_grains_of_two_materials_move_as_grains_of_one_where_their_contacts_are_equal(alone):
    # with one material the contact constants are loaded once a step, with two for every pair
    equal, unequal = alone.mixed
    assert alone.one == equal == alone.end
    assert unequal != equal


@pytest.mark.slow
def test_lists_that_are_too_short_grow_and_change_no_bit(alone):
    sim = simulation.assemble([heap(GRAINS, 1)], LAWS, Numerics("cpu", 1))
    tiny = replace(sim.capacities, pairs=PAIRS_TOO_FEW, wall_pairs=WALL_PAIRS_TOO_FEW)
    reallocate_fields(sim, tiny)
    simulation.advance(sim, [HALF])
    grown, half = sim.capacities, fingerprint(simulation.snapshot(sim, 0))
    # a checkpoint of grown lists meets a fresh run; both lists halved grow to what has been compiled above
    reallocate_fields(sim, replace(tiny, pairs=PAIRS_FAR_TOO_FEW, wall_pairs=WALL_PAIRS_TOO_FEW // 2))
    simulation.import_state(sim, alone.state)
    simulation.advance(sim, [WHOLE])
    assert fingerprint(simulation.snapshot(sim, 0)) == alone.end
    assert grown.pairs > tiny.pairs
    assert sim.capacities.pairs > PAIRS_FAR_TOO_FEW
    assert half == alone.half


def test_workers_that_share_a_heap_change_no_bit(same_in_teams):
    same_in_teams(heap(GRAINS, 1), LAWS, lambda sim: ends(sim, HALF))


@pytest.mark.slow
def test_two_teams_of_two_change_no_bit(monkeypatch):
    monkeypatch.setattr(capacities, "PARTITION_GRAINS", GRAINS // 2)
    pair = [heap(GRAINS, 1), heap(GRAINS, 2)]
    assert run(pair, 4, HALF) == run(pair, 1, HALF)
