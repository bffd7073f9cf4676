"""Neighbour lists under wind, where a few fast or large grains are searched beyond adjacent cells."""

from dataclasses import replace

import numpy as np
import pytest
from grain_worlds import RADIUS
from windy_beds import bed

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.simulation import advance, assemble, export_state

LAWS = Laws(drag="two_limits")
LAYERS = 6
FAST = 3.0  # m s-1, which takes a grain through several cells on one list


def mixed(fast: int) -> Setup:
    """Loose layers of grains between half and the full radius, so many of which fly upwards."""
    table = bed(1, layers=LAYERS)
    rng = np.random.default_rng(2)
    velocity = table.grains.velocity.copy()
    velocity[rng.permutation(len(velocity))[:fast]] = (0.0, 0.0, FAST)
    radius = RADIUS * rng.uniform(0.5, 1.0, len(velocity))
    return replace(table, grains=replace(table.grains, velocity=velocity, radius=radius))


@pytest.mark.parametrize(("fast", "crowded"), [(0, 0), (12, 0), (200, 1)])
def test_every_pair_that_may_touch_before_the_next_rebuild_is_listed_once(fast: int, crowded: int):
    table = mixed(fast)
    sim = assemble([table], LAWS, Numerics("cpu", 1, "f64"))
    advance(sim, [table.time_step])
    assert int(sim.world.replicas.crowded[0]) == crowded
    state = {k.removeprefix("replica0_"): v for k, v in export_state(sim).items()}
    stop_device()
    place, grasp = state["origin"], state["radius"] + np.sqrt(state["skin_squared"])
    apart = place[:, None] - place[None, :]
    period = np.asarray(table.period)[:2]
    apart[..., :2] -= period * np.round(apart[..., :2] / period)
    near = np.triu(np.linalg.norm(apart, axis=-1) < grasp[:, None] + grasp[None, :], 1)
    listed = np.zeros(near.shape, dtype=int)
    owner = np.repeat(np.arange(len(place)), state["pair_number"])
    np.add.at(listed, (owner, state["pair_neighbour"].astype(int)), 1)
    np.testing.assert_array_equal(np.triu(listed + listed.T, 1), near)
    # the case is what it says: with wide grains some pairs lie further apart than two cells allow
    assert (np.linalg.norm(apart, axis=-1)[near].max() > 4.0 * RADIUS) == (fast == 12)
