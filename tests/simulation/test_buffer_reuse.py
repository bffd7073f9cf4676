"""An ensemble in the fields of one that has ended: the same bits as alone, and nothing of the one before."""

from dataclasses import replace

import pytest
from grain_worlds import fingerprint, heap
from own_effects import acted_on

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.simulation import Simulation, advance, assemble, reuse_or_assemble, snapshot

LAWS, NUMERICS = Laws(rolling="elastic_plastic"), Numerics("cpu", 1)
FALLEN = 0.01  # s, half way down


def with_effect(setup: Setup, name: str) -> Setup:
    return acted_on(setup, {"grain_diameter": 1e-3}, **{name: {}})


PLAIN, STICKY = heap(60, 1), with_effect(heap(80, 2), "surface_crust")
OTHERS = [heap(90, 3), with_effect(heap(40, 4), "surface_crust"), heap(20, 5)]


def ends(sim: Simulation) -> list[str]:
    """Bits of all replicas after a while."""
    advance(sim, [FALLEN] * len(sim.setups))
    return [fingerprint(snapshot(sim, r)) for r in range(len(sim.setups))]


def test_what_runs_after_another_ensemble_comes_out_as_if_it_had_been_alone():
    alone = []
    for setup in OTHERS:
        alone += ends(assemble([setup], LAWS, NUMERICS))
        stop_device()
    before = assemble([PLAIN, STICKY, PLAIN, STICKY], LAWS, NUMERICS)
    ends(before)
    after = reuse_or_assemble(before, OTHERS, LAWS, NUMERICS)
    assert after is before
    assert ends(after) == alone
    again = reuse_or_assemble(after, OTHERS, LAWS, NUMERICS)
    assert ends(again) == alone
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
