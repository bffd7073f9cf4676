"""Forces between grains conserve momentum, in partitions and with one thread per grain."""

from collections.abc import Callable

import numpy as np
import pytest
from grain_worlds import NONE, RADIUS, contacts, grains, setup

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.simulation import Simulation, advance, assemble, capacities, snapshot

GRAINS, PARTITION = 216, 54
HALF, WHOLE = 1e-4, 1.5e-4  # s, while grains touch; no rebuild between them mends the lists
ROUNDING = {"f32": 1e-6, "f64": 1e-14}  # of velocities, over their changes by dozens of steps [1]


def cloud() -> Setup:
    """A block of grains without weight or walls, stirred at random."""
    rng = np.random.default_rng(1)
    sites = np.stack(np.meshgrid(*[np.arange(6)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    speed, spin = rng.normal(0.0, 0.02, sites.shape), rng.normal(0.0, 9.0, sites.shape)
    table = grains(1.99 * RADIUS * sites, speed, spin)
    return setup(table, NONE, contacts(rolling=0.1), gravity=(0.0, 0.0, 0.0))


def imbalance(sim: Simulation, until: float) -> float:
    """Change of the momentum of all grains over the sum of the changes of each [1]."""
    before = snapshot(sim, 0).velocity
    advance(sim, [until])
    change = snapshot(sim, 0).velocity - before
    return float(np.linalg.norm(change.sum(axis=0)) / np.linalg.norm(change, axis=1).sum())


def without_some_partitions(sim: Simulation) -> None:
    """The first partition reaches fewer ranks behind its own than its lists hold."""
    high = sim.world.replicas.after_high.to_numpy()
    high[0, 0] = PARTITION
    sim.world.replicas.after_high.from_numpy(high)


def without_some_reverse_lists(sim: Simulation) -> None:
    """Half of the grains are the second of no pair."""
    stop = sim.buffers.stop.to_numpy()
    sim.buffers.stop.from_numpy(np.minimum(stop, stop[GRAINS // 2]))


@pytest.mark.parametrize(
    ("numerics", "lose"),
    [
        (Numerics("cpu", 1), without_some_partitions),
        pytest.param(Numerics("cpu", 2, "f64", "grains"), without_some_reverse_lists, marks=pytest.mark.slow),
    ],
)
def test_forces_between_grains_cancel_to_rounding_unless_reactions_are_lost(
    monkeypatch: pytest.MonkeyPatch, numerics: Numerics, lose: Callable[[Simulation], None]
):
    monkeypatch.setattr(capacities, "PARTITION_GRAINS", PARTITION)
    sim = assemble([cloud()], Laws(rolling="elastic_plastic"), numerics)
    kept = imbalance(sim, HALF)
    lose(sim)
    lost = imbalance(sim, WHOLE)
    stop_device()
    assert kept < ROUNDING[numerics.precision]
    assert lost > 1e-3
