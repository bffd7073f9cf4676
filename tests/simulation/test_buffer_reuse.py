"""An ensemble in the fields of one that has ended: the same bits as alone, and nothing of the one before."""

from dataclasses import replace

import numpy as np
import pytest
from grain_worlds import contacts, ends, heap
from own_effects import acted_on

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import ContactTable, Laws, Numerics, Setup, Surface
from taichi_erosion.simulation import assemble, reuse_or_assemble, set_contacts

LAWS, NUMERICS = Laws(rolling="elastic_plastic"), Numerics("cpu", 1)
FALLEN = 0.01  # s, half way down
SLIPPERY = contacts(0.0, 0.0)


def with_effect(setup: Setup, name: str) -> Setup:
    return acted_on(setup, {"grain_diameter": 1e-3}, **{name: {}})


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


PLAIN, STICKY = heap(60, 1), with_effect(heap(80, 2), "surface_crust")
OTHERS = [heap(90, 3), three_materials(50, 2), with_effect(heap(40, 4), "surface_crust"), heap(20, 5)]


def test_what_runs_after_another_ensemble_comes_out_as_if_it_had_been_alone():
    """With few materials and many, with and without an effect, and with contacts that have changed."""
    alone = []
    for setup in (*OTHERS, replace(OTHERS[0], contacts=SLIPPERY)):
        alone += ends(assemble([setup], LAWS, NUMERICS), FALLEN)
        stop_device()
    assert len(set(alone)) == len(alone)
    sim = assemble([PLAIN, STICKY, three_materials(90, 1), STICKY], LAWS, NUMERICS)
    ends(sim, FALLEN)
    for slips in (False, True):
        assert reuse_or_assemble(sim, OTHERS, LAWS, NUMERICS) is sim
        if slips:
            set_contacts(sim, 0, SLIPPERY)
        assert ends(sim, FALLEN) == [alone[-1] if slips else alone[0], *alone[1:-1]]
    stop_device()


BESIDE, CHARGED = [PLAIN, STICKY], [with_effect(PLAIN, "electric_field")]


@pytest.mark.parametrize(
    ("first", "setups", "laws"),
    [
        (BESIDE, [PLAIN], replace(LAWS, rolling="none")),
        (BESIDE, [with_effect(PLAIN, "liquid_bridge")], LAWS),
        (BESIDE, CHARGED, LAWS),
        (BESIDE, [heap(200, 1)], LAWS),
        (CHARGED, [PLAIN], LAWS),  # an effect on single grains stays with ensembles that have it
    ],
)
def test_other_laws_other_effects_and_more_grains_get_fields_of_their_own(first, setups, laws):
    before = assemble(first, LAWS, NUMERICS)
    assert reuse_or_assemble(before, setups, laws, NUMERICS) is not before
    stop_device()
