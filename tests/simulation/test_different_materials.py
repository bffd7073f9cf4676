"""Replicas with different numbers of materials beside each other: each has its own contact parameters."""

from dataclasses import replace

import numpy as np
import pytest
from grain_worlds import contacts, fingerprint, heap

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import ContactTable, Laws, Numerics, Setup, Surface, pair_row, pair_rows
from taichi_erosion.simulation import Simulation, advance, reuse_or_assemble, set_contacts, snapshot

LAWS, NUMERICS = Laws(rolling="elastic_plastic"), Numerics("cpu", 1)
FALLEN = 0.01  # s, half way down


def three_materials(count: int, seed: int) -> Setup:
    """A heap of grains of the second of three materials: floor of the first, tube of the third."""
    own = heap(count, seed)
    columns = {name: np.full(6, values[0]) for name, values in vars(contacts(rolling=0.1)).items()}
    columns |= {"friction_sliding": np.linspace(0.0, 1.0, 6), "restitution": np.linspace(0.3, 0.8, 6)}
    return replace(
        own,
        grains=replace(own.grains, material=np.ones_like(own.grains.material)),
        materials=("earth", "soil", "steel"),
        contacts=ContactTable(**columns),
        surfaces=(Surface("floor", 0), Surface("tube", 2)),
    )


def ends(sim: Simulation) -> list[str]:
    """Bits of all replicas after a while."""
    advance(sim, [FALLEN] * len(sim.setups))
    return [fingerprint(snapshot(sim, r)) for r in range(len(sim.setups))]


MIXED = {
    "few": heap(40, 1),
    "three": three_materials(50, 2),
    "other few": heap(30, 3),
    "other three": three_materials(20, 4),
}
SLIPPERY = contacts(0.0, 0.0)


@pytest.mark.parametrize("own", [1, 2, 3, 5])
def test_rows_of_the_first_materials_are_those_of_their_pairs(own):
    found = iter(pair_rows(own, 5))
    for i in range(own):
        for j in range(i, own):
            assert next(found) == pair_row(i, j, 5)


def test_replicas_with_few_and_with_three_materials_come_out_as_alone():
    """And so does one whose contacts change; kernels compile once for each number of materials."""
    alone: dict[str, str] = {}
    slippery: list[str] = []
    for count in (2, 3):
        sim = None
        for name, setup in MIXED.items():
            if len(setup.materials) == count:
                sim = reuse_or_assemble(sim, [setup], LAWS, NUMERICS)
                (alone[name],) = ends(sim)
        sim = reuse_or_assemble(sim, list(MIXED.values()) if count == 3 else [MIXED["few"]], LAWS, NUMERICS)
        beside = ends(sim)
        sim = reuse_or_assemble(sim, sim.setups, LAWS, NUMERICS)
        set_contacts(sim, 0, SLIPPERY)
        slippery.append(ends(sim)[0])
        stop_device()
    assert beside == [alone[name] for name in MIXED]
    assert slippery[0] == slippery[1] != alone["few"]
