"""Neighbour lists of a cloud, and of beds whose fast grains are searched beyond adjacent cells."""

from dataclasses import replace

import numpy as np
import pytest
from grain_worlds import NONE, RADIUS, TIME_STEP, grains, setup
from windy_beds import bed

from taichi_erosion.core.setup import Floats, Laws, Numerics, Setup
from taichi_erosion.simulation import advance, assemble, export_state

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
LAWS = Laws(rolling="elastic_plastic", drag="two_limits")
FAST = 3.0  # m s-1, which takes a grain through several cells on one list
BEDS = 8  # of a strip


def mixed(fast: int) -> Setup:
    """Loose layers of grains between half and the full radius, so many of which fly upwards."""
    table = bed(1, layers=6)
    rng = np.random.default_rng(2)
    velocity = table.grains.velocity.copy()
    velocity[rng.permutation(len(velocity))[:fast]] = (0.0, 0.0, FAST)
    radius = RADIUS * rng.uniform(0.5, 1.0, len(velocity))
    return replace(table, grains=replace(table.grains, velocity=velocity, radius=radius))


def strip(fast: int) -> Setup:
    """Such beds in a row, longer than the box in which a wide grain is searched."""
    table = mixed(fast)
    columns = {name: np.concatenate([column] * BEDS) for name, column in vars(table.grains).items()}
    columns["position"][:, 0] += np.arange(BEDS).repeat(len(table.grains.radius)) * table.period[0]
    (_, *high), (long, *across) = table.domain[1], table.period
    domain = table.domain[0], (table.domain[0][0] + BEDS * long, *high)
    return replace(
        table, grains=replace(table.grains, **columns), domain=domain, period=(BEDS * long, *across)
    )


def cloud() -> Setup:
    """Grains at random places in the void, that fly apart."""
    rng = np.random.default_rng(2)
    place = rng.uniform(0.0, 30.0 * RADIUS, (400, 3))
    return setup(grains(place, 0.3 * rng.normal(size=place.shape)), NONE, gravity=(0.0, 0.0, 0.0))


def distances(place: Floats, table: Setup) -> Floats:
    """Of all grains to all, across periods along x and y [n, n]."""
    apart = place[:, None] - place[None, :]
    for axis in range(2):
        if period := table.period[axis]:
            apart[..., axis] -= period * np.round(apart[..., axis] / period)
    return np.linalg.norm(apart, axis=-1)


@pytest.mark.parametrize(
    ("table", "until", "crowded", "wide"),
    [
        (mixed(0), TIME_STEP, 0, False),
        (mixed(12), TIME_STEP, 0, True),
        (strip(2), TIME_STEP, 0, True),
        (mixed(200), TIME_STEP, 1, False),
        (cloud(), 2e-3, 0, False),  # it has spread from where the scene put it
    ],
    ids=("all slow", "few fast", "few fast of a strip", "many fast", "cloud"),
)
def test_every_pair_that_may_touch_before_the_next_rebuild_is_listed_once(table, until, crowded, wide):
    sim = assemble([table], LAWS, Numerics("cpu", 1, "f64"))
    advance(sim, [until])
    assert int(sim.world.replicas.crowded[0]) == crowded
    state = {k.removeprefix("replica0_"): v for k, v in export_state(sim).items()}
    apart, grasp = distances(state["origin"], table), state["radius"] + np.sqrt(state["skin_squared"])
    near = np.triu(apart < grasp[:, None] + grasp[None, :], 1)
    listed = np.zeros(near.shape, dtype=int)
    owner = np.repeat(np.arange(len(apart)), state["pair_number"])
    np.add.at(listed, (owner, state["pair_neighbour"].astype(int)), 1)
    listed = np.triu(listed + listed.T, 1)
    np.testing.assert_array_equal(listed, near)
    now = distances(state["origin"] + state["shift"], table)
    assert np.all(listed[np.triu(now < state["radius"][:, None] + state["radius"][None, :], 1)] == 1)
    # the case is what it says: with wide grains some pairs lie further apart than two cells allow
    assert (apart[near].max() > 4.0 * RADIUS) == wide
