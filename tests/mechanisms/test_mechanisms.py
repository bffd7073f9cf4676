"""Every mechanism honours the contract of effects, has a dose, and stays out of the list of effects."""

from collections.abc import Iterator
from dataclasses import fields

import pytest

from taichi_erosion.core.device import start_device, stop_device
from taichi_erosion.core.effect import Probe
from taichi_erosion.core.effect_probe import Bench, make_bench, probe_of
from taichi_erosion.core.setup import Numerics
from taichi_erosion.effects import load_library
from taichi_erosion.mechanisms.library import DOSE, dose_range, load_mechanisms, mechanism_file
from taichi_erosion.verification.effect_contract import CLAUSES

BASIS = load_mechanisms()


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    start_device(Numerics("cpu", 1))
    yield make_bench()
    stop_device()


@pytest.fixture(scope="module")
def probes() -> dict[str, Probe]:
    return {}


@pytest.mark.parametrize("clause", CLAUSES.values(), ids=CLAUSES.keys())
@pytest.mark.parametrize("name", BASIS)
def test_every_mechanism_keeps_the_contract_of_effects(name, clause, bench, probes):
    if name not in probes:
        probes[name] = probe_of(BASIS[name], bench)
    assert list(clause(BASIS[name], probes[name])) == []


@pytest.mark.parametrize("name", BASIS)
def test_the_first_parameter_of_a_mechanism_is_its_dimensionless_dose(name):
    first = fields(BASIS[name].params)[0]
    assert (first.name, first.metadata["unit"]) == (DOSE, "1")
    low, high = dose_range(BASIS[name])
    assert low <= 0.0 < high


def test_mechanisms_are_not_listed_as_effects_and_share_no_name_with_them():
    assert len(BASIS) == 17
    assert not set(BASIS) & set(load_library())


def test_a_file_of_a_mechanism_is_an_effect_file():
    path = mechanism_file("rolling_friction")
    assert load_library([path])["rolling_friction"].title == "a factor of rolling friction"
