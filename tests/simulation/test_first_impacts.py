"""Self-checks of a run: impacts of its pairs of materials, and the count of its grains."""

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from grain_worlds import TIME_STEP, contacts, heap

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.core.snapshot import Status
from taichi_erosion.run import sanity_checks
from taichi_erosion.run.sanity_checks import count_failure, restitution_failure
from taichi_erosion.simulation import Simulation, assemble
from taichi_erosion.simulation.first_impacts import Impact, first_impacts

pytestmark = pytest.mark.engine

RESTITUTIONS = (0.1, 0.5, 0.9)
SPEED = 0.5  # m s-1
EXACT = 0.005  # of the coefficient with a hundred steps in a contact: the bound of V04 [1]
FINE = TIME_STEP / 5.0  # s
COARSE = 20.0 * TIME_STEP  # s, one step in a contact


def with_restitution(restitution: float, time_step: float) -> Setup:
    return replace(heap(20, 1), contacts=contacts(restitution=restitution), time_step=time_step)


@pytest.fixture(scope="module")
def sim() -> Iterator[Simulation]:
    """Three heaps with fine steps, one with far too coarse ones."""
    fine = [with_restitution(e, FINE) for e in RESTITUTIONS]
    yield assemble([*fine, with_restitution(0.5, COARSE)], Laws(), Numerics("cpu", 1))
    stop_device()


@pytest.fixture(scope="module")
def impacts(sim: Simulation) -> list[Impact]:
    return first_impacts(sim, [SPEED] * 4)


def forced(insists: bool) -> Any:
    return SimpleNamespace(run=SimpleNamespace(force_time_step=insists))


def test_grains_and_walls_give_back_what_is_stated(impacts):
    for replica, stated in enumerate(RESTITUTIONS):
        own = [impact for impact in impacts if impact.replica == replica]
        assert len(own) == 2  # on a grain and on a wall
        assert all(impact.found == pytest.approx(stated, abs=EXACT) for impact in own)
        assert restitution_failure(impacts, replica, forced(False), 0.0) is None


def test_a_step_too_long_for_an_impact_stops_the_replica_unless_somebody_insists(impacts):
    failed = restitution_failure(impacts, 3, forced(False), 0.001)
    assert failed is not None
    assert failed.status == Status.RESTITUTION
    assert restitution_failure(impacts, 3, forced(True), 0.001) is None


def test_adhesion_may_take_any_share_of_the_speed_but_give_none():
    slow = Impact(0, "soil-soil", SPEED, stated=0.6, found=0.0, adhesive=True)
    fast = replace(slow, found=0.75)
    assert restitution_failure([slow], 0, forced(False), 0.0) is None
    assert restitution_failure([fast], 0, forced(False), 0.0) is not None


def test_an_impact_that_is_not_a_number_stops_the_replica():
    lost = Impact(0, "soil-soil", SPEED, stated=0.6, found=float("nan"), adhesive=False)
    assert restitution_failure([lost], 0, forced(False), 0.0) is not None


def test_a_first_impact_leaves_the_grains_alone_and_all_are_counted(sim, impacts):
    assert all(count_failure(sim, replica, 0.0) is None for replica in range(4))


@pytest.mark.parametrize(
    ("damage", "status"),
    [
        (lambda state: replace(state, ident=np.where(state.ident == 7, 6, state.ident)), Status.COUNT),
        (lambda state: replace(state, mass=1.001 * state.mass), Status.COUNT),
        (lambda state: replace(state, velocity=np.nan * state.velocity), Status.NOT_FINITE),
    ],
    ids=["a grain twice", "mass from nowhere", "not a number"],
)
def test_a_grain_that_is_missing_doubled_or_nowhere_is_noticed(sim, impacts, monkeypatch, damage, status):
    read = sanity_checks.snapshot
    monkeypatch.setattr(sanity_checks, "snapshot", lambda sim, replica: damage(read(sim, replica)))
    failed = count_failure(sim, 0, 0.002)
    assert failed is not None
    assert failed.status == status
