"""Pair forces conserve momentum, and the check of it changes no bit of a run."""

import pytest
from grain_worlds import TIME_STEP, fingerprint, heap

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Laws, Numerics
from taichi_erosion.core.snapshot import Status
from taichi_erosion.run.sanity_checks import MOMENTUM_ERROR, momentum_failure
from taichi_erosion.simulation import Simulation, advance, assemble, capacities, force_imbalance, snapshot
from taichi_erosion.simulation.capacities import SMALL_GRAINS

GRAINS, PARTITION = 200, 50
HALF, WHOLE = 0.005, 0.01  # s
ROUNDING = {"f32": 2.0**-24, "f64": 2.0**-53}  # of one force [1]


def collapsing(monkeypatch: pytest.MonkeyPatch, precision: str) -> Simulation:
    """A heap in four partitions, half way down."""
    monkeypatch.setattr(capacities, "PARTITION_GRAINS", PARTITION)
    sim = assemble([heap(GRAINS, 1)], Laws(rolling="elastic_plastic"), Numerics("cpu", 1, precision))
    advance(sim, [HALF])
    return sim


@pytest.mark.parametrize("precision", ["f32", pytest.param("f64", marks=pytest.mark.slow)])
def test_forces_between_grains_cancel_to_rounding_and_looking_changes_no_bit(monkeypatch, precision):
    ends = []
    for checks in (0, 2):
        sim = collapsing(monkeypatch, precision)
        # every contact is rounded a few times; the sum of all errors is below that of their sizes
        assert all(force_imbalance(sim, 0) < 10.0 * ROUNDING[precision] for _ in range(checks))
        advance(sim, [WHOLE])
        ends.append(fingerprint(snapshot(sim, 0)))
        stop_device()
    assert ends[0] == ends[1]


def test_reactions_that_are_lost_between_workers_stop_the_replica(monkeypatch):
    sim = collapsing(monkeypatch, "f32")
    assert momentum_failure(sim, 0, HALF) is None
    high = sim.world.replicas.after_high.to_numpy()
    # the range of ranks that the first partition reaches is wrong
    high[0, 0] = PARTITION
    sim.world.replicas.after_high.from_numpy(high)
    failed = momentum_failure(sim, 0, HALF)
    stop_device()
    assert failed is not None
    assert failed.status == Status.MOMENTUM
    assert failed.value > 100.0 * MOMENTUM_ERROR


def test_grains_that_do_not_touch_exchange_nothing():
    sim = assemble([heap(SMALL_GRAINS, 1)], Laws(rolling="elastic_plastic"), Numerics("cpu", 1))
    advance(sim, [TIME_STEP])
    assert force_imbalance(sim, 0) == 0.0
    stop_device()
