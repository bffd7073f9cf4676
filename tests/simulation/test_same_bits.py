"""A replica gives the same bits alone and in company, on one worker or two, resumed, after lists grew."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from grain_worlds import contacts, fingerprint, grains, heap, setup

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.simulation import (
    Simulation,
    advance,
    assemble,
    capacities,
    export_state,
    failure,
    import_state,
    reuse_or_assemble,
    snapshot,
    totals,
)
from taichi_erosion.simulation.assemble import reallocate
from taichi_erosion.simulation.capacities import partition_count

LAWS = Laws(rolling="elastic_plastic")
GRAINS = 120
HALF, WHOLE = 0.005, 0.01  # s
PAIRS_TOO_FEW = 160  # entries; the heap wants more than these and fewer than twice as many
WALL_PAIRS_TOO_FEW = 64
PAIRS_FAR_TOO_FEW = 80  # fewer than the heap holds half way


def ends(sim: Simulation, until: float) -> list[str]:
    """Bits of all replicas at a time, none of which may fail."""
    advance(sim, [until] * len(sim.setups))
    assert all(failure(sim, r) is None for r in range(len(sim.setups)))
    return [fingerprint(snapshot(sim, r)) for r in range(len(sim.setups))]


def run(setups: list[Setup], threads: int, until: float) -> list[str]:
    sim = assemble(setups, LAWS, Numerics("cpu", threads))
    bits = ends(sim, until)
    stop_device()
    return bits


@pytest.fixture(scope="module")
def alone() -> dict[str, object]:
    """One heap on one worker, half way and at the end, with its state and contacts half way; then others."""
    numerics = Numerics("cpu", 1)
    sim = assemble([heap(GRAINS, 1)], LAWS, numerics)
    (half,) = ends(sim, HALF)
    state, contacts_then = export_state(sim), totals(sim, 0).contacts
    (end,) = ends(sim, WHOLE)
    import_state(sim, state)
    back = fingerprint(snapshot(sim, 0))
    (again,) = ends(sim, WHOLE)
    others = reuse_or_assemble(sim, [heap(GRAINS, 1), *of_two_materials()], LAWS, numerics)
    assert others is sim  # kernels compile once
    one, *mixed = ends(others, WHOLE)
    stop_device()
    return locals()


def of_two_materials() -> list[Setup]:
    """The heap with every other grain of a second material: of equal contacts, and of smoother ones."""
    one = heap(GRAINS, 1)
    grains = replace(one.grains, material=np.arange(GRAINS, dtype=np.int32) % 2)
    smooth = replace(one.contacts, friction_sliding=np.array([0.5, 0.1, 0.1]))
    return [replace(one, grains=grains), replace(one, grains=grains, contacts=smooth)]


def test_a_run_put_back_to_an_earlier_state_repeats_itself(alone):
    assert alone["contacts_then"] > 10  # springs are stretched
    assert alone["back"] == alone["half"]
    assert alone["again"] == alone["end"] != alone["half"]


def test_neighbours_in_an_ensemble_and_a_second_worker_change_no_bit(alone):
    # three replicas on two workers: one of them is begun by one worker and ended by the other
    ensemble = [heap(GRAINS // 2, 3, friction=0.1), heap(GRAINS, 1), heap(GRAINS, 2)]
    bits = run(ensemble, 2, WHOLE)
    assert bits[1] == alone["end"]
    assert bits[1] != bits[2], "heaps of different seeds"


def test_grains_of_two_materials_move_as_grains_of_one_where_their_contacts_are_equal(alone):
    # with one material the contact constants are loaded once a step, with two for every pair
    equal, unequal = alone["mixed"]
    assert alone["one"] == equal == alone["end"]
    assert unequal != equal


@pytest.mark.slow
def test_lists_that_are_too_short_grow_and_change_no_bit(alone):
    sim = assemble([heap(GRAINS, 1)], LAWS, Numerics("cpu", 1))
    tiny = replace(sim.capacities, pairs=PAIRS_TOO_FEW, wall_pairs=WALL_PAIRS_TOO_FEW)
    reallocate(sim, tiny)
    advance(sim, [HALF])
    grown, half = sim.capacities, fingerprint(snapshot(sim, 0))
    # a checkpoint of grown lists meets a fresh run; both lists halved grow to what has been compiled above
    reallocate(sim, replace(tiny, pairs=PAIRS_FAR_TOO_FEW, wall_pairs=WALL_PAIRS_TOO_FEW // 2))
    import_state(sim, alone["state"])
    advance(sim, [WHOLE])
    end = fingerprint(snapshot(sim, 0))
    stop_device()
    assert grown.pairs > tiny.pairs
    assert sim.capacities.pairs > PAIRS_FAR_TOO_FEW
    assert half == alone["half"]
    assert end == alone["end"]


def test_workers_that_share_a_heap_change_no_bit(monkeypatch, request):
    monkeypatch.setattr(capacities, "PARTITION_GRAINS", GRAINS // 2)
    assert partition_count(heap(GRAINS, 1)) == 2
    sim = assemble([heap(GRAINS, 1)], LAWS, Numerics("cpu", 2))
    two = ends(sim, HALF)
    sizes = request.getfixturevalue("uneven_teams")
    uneven = ends(reuse_or_assemble(sim, [heap(GRAINS, 1)], LAWS, sim.numerics), HALF)
    launches = import_module("taichi_erosion.simulation.advance")
    monkeypatch.setattr(launches, "team_size", lambda team, most: 1)
    one = ends(reuse_or_assemble(sim, [heap(GRAINS, 1)], LAWS, sim.numerics), HALF)
    stop_device()
    assert {1, 2} == set(sizes)
    assert one == two == uneven


@pytest.mark.slow
def test_teams_that_change_their_size_change_no_bit(monkeypatch, request):
    monkeypatch.setattr(capacities, "PARTITION_GRAINS", GRAINS // 2)
    pair = [heap(GRAINS, 1), heap(GRAINS, 2)]
    one = run(pair, 1, HALF)
    sizes = request.getfixturevalue("uneven_teams")
    four = run(pair, 4, HALF)  # two teams of two
    assert {1, 2} == set(sizes)
    assert four == one


def bed() -> Setup:
    """Enough grains for two partitions, in contact from the start, stirred at random."""
    rng = np.random.default_rng(5)
    axes = np.meshgrid(np.arange(30), np.arange(30), np.arange(10), indexing="ij")
    sites = np.stack(axes, axis=-1).reshape(-1, 3)
    place = 0.99e-3 * np.column_stack([sites[:, :2], sites[:, 2] + 0.5])
    table = grains(place, rng.normal(0.0, 0.02, place.shape), rng.normal(0.0, 20.0, place.shape))
    return setup(table, law=contacts(rolling=0.1))


@pytest.mark.slow
def test_two_workers_that_share_a_bed_of_nine_thousand_change_no_bit():
    assert partition_count(bed()) == 2
    (one,) = run([bed()], 1, 2e-4)
    (two,) = run([bed()], 2, 2e-4)
    assert one == two
