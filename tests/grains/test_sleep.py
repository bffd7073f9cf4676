"""Deep grains that sleep: they lie where they lay, carry what rests on them, wake when hit, lose no bit."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from grain_worlds import GRAVITY, RADIUS, TIME_STEP, contacts, fingerprint
from windy_beds import DENSITY, SIDE, bed

from taichi_erosion import simulation
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.grains.sleep import FALLING_ASLEEP
from taichi_erosion.simulation import Simulation

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
LAWS = Laws(rolling="elastic_plastic", drag="two_limits")
LOOKS, LOOK_STEPS = 20, 5  # a millisecond at rest
SETTLED, WATCHED = 0.15, 0.02  # s
BREEZE = 0.1  # m s-1, friction velocity far below that which moves these grains
LIFTED = 0.5 * RADIUS
SHARED = 6e-3  # s, that two workers go on after a grain has hit the bed: all wake, and some sleep again
FALL = np.sqrt(2.0 * LIFTED / GRAVITY)  # s


def rough(seed: int, layers: int = 3) -> Setup:
    """A bed whose grains resist rolling, else some roll on for long."""
    return replace(bed(seed, layers), contacts=contacts(rolling=0.2))


def drowsy(seed: int, layers: int = 3) -> Setup:
    awake = rough(seed, layers)
    return replace(awake, coupling=replace(awake.coupling, sleep_exchanges=LOOKS, sleep_share=0.1))


def asleep(sim: Simulation, replica: int = 0) -> Any:
    """Which grains sleep, by row of the GrainTable."""
    state = simulation.export_state(sim)
    order = np.argsort(state[f"replica{replica}_ident"])
    return state[f"replica{replica}_sleep_state"][order] >= FALLING_ASLEEP


def lifted(state: dict[str, Any]) -> dict[str, Any]:
    """The same state with its highest grain above its place, awake."""
    out = {name: values.copy() for name, values in state.items()}
    top = int(np.argmax(out["replica0_origin"][:, 2]))
    out["replica0_origin"][top, 2] += LIFTED
    out["replica0_sleep_state"][top] = out["replica0_sleep_rest_count"][top] = 0
    out["stale"][:] = 1.0
    return out


@pytest.fixture(scope="module")
def nights() -> SimpleNamespace:
    """A bed that settles and falls asleep, in a breeze, hit by a grain, put back, and tilted."""
    sim, night = simulation.assemble([drowsy(1)], LAWS, Numerics("cpu", 1)), SimpleNamespace()
    simulation.advance(sim, [SETTLED])
    night.state, night.still = simulation.export_state(sim), asleep(sim)
    night.before = simulation.snapshot(sim, 0)
    simulation.advance(sim, [SETTLED + WATCHED])
    night.after, night.later = simulation.snapshot(sim, 0), asleep(sim)
    night.end = fingerprint(night.after)
    simulation.import_state(sim, night.state)
    simulation.advance(sim, [SETTLED + WATCHED])
    night.again = fingerprint(simulation.snapshot(sim, 0))
    simulation.spin_up_wind(sim, 0, BREEZE)
    simulation.advance(sim, [SETTLED + 2.0 * WATCHED])
    night.residual_momentum = sim.coupling.exchange.residual_momentum.to_numpy()[0, :, 0].sum()
    night.breeze, night.blown = simulation.air_profile(sim, 0), asleep(sim)
    simulation.import_state(sim, lifted(night.state))
    night.hit = []
    for time in SETTLED + FALL + np.linspace(-1e-3, 4e-3, 11):
        simulation.advance(sim, [time])
        night.hit.append(np.count_nonzero(asleep(sim)))
    simulation.advance(sim, [2.0 * SETTLED])
    night.calmed = asleep(sim)
    simulation.set_replica_gravity(sim, 0, (GRAVITY, 0.0, 0.0))
    night.tilted = asleep(sim)
    return night


def test_a_bed_at_rest_falls_asleep_lies_where_it_lay_and_goes_on_bit_for_bit_when_resumed(nights):
    still = nights.still & nights.later
    assert still.mean() > 0.9
    assert np.array_equal(nights.after.position[still], nights.before.position[still])
    assert not nights.after.velocity[still].any()
    assert nights.again == nights.end


def test_a_bed_lies_as_it_does_awake_and_sleeps_alike_in_company(nights):
    sim = simulation.assemble([rough(1), drowsy(1)], LAWS, Numerics("cpu", 2))
    simulation.advance(sim, [SETTLED] * 2)
    awake, nobody = simulation.snapshot(sim, 0), asleep(sim)
    simulation.advance(sim, [SETTLED + WATCHED] * 2)
    company = fingerprint(simulation.snapshot(sim, 1))
    assert company == nights.end
    assert not nobody.any()
    # grains fall asleep once they have come to rest: what is left of their motion is a creep
    away = np.abs(awake.position[:, 2] - nights.before.position[:, 2])
    assert np.median(away) < 0.01 * RADIUS
    assert away.max() < 0.2 * RADIUS


@pytest.mark.slow
def test_grains_sleep_and_wake_alike_with_one_thread_per_grain(nights):
    found = []
    for decomposition in ("partitions", "grains"):
        sim = simulation.assemble([drowsy(1)], LAWS, Numerics("cpu", 2, "f64", decomposition))
        simulation.import_state(sim, lifted(nights.state))
        simulation.advance(sim, [SETTLED + FALL + 4e-3])
        found.append((asleep(sim), simulation.snapshot(sim, 0).position))
    (want, places), (same, others) = found
    assert 0 < np.count_nonzero(want) < np.count_nonzero(nights.still), "some must have woken"
    assert np.array_equal(same, want)
    # the same forces in another order, some hundred steps long
    assert np.abs(others - places).max() < 1e-12 * SIDE


def test_the_air_loses_what_sleepers_take_from_it(nights):
    breeze = nights.breeze
    assert nights.blown.mean() > 0.9
    height, interval = np.diff(breeze.face), LOOK_STEPS * TIME_STEP
    taken = -(breeze.drag[:, 0] * height).sum()
    # the stress at the lid goes to grains and, under three layers of them, hardly to the floor
    assert taken == pytest.approx(DENSITY * BREEZE**2, rel=0.02)
    # the residual is the drag of one interval, which the grains receive until the next: nothing has piled up
    assert nights.residual_momentum == pytest.approx(taken * SIDE**2 * interval, rel=0.02)


def test_a_grain_that_falls_on_sleepers_wakes_those_it_hits_and_gravity_that_turns_wakes_all(nights):
    hit = nights.hit
    assert min(hit) < hit[0] - 3
    assert np.count_nonzero(nights.calmed) >= hit[0], "all sleep again"
    assert not nights.tilted.any()


@pytest.mark.slow
def test_workers_that_share_a_sleeping_bed_change_no_bit(same_in_teams):
    def woken(sim: Simulation) -> str:
        simulation.advance(sim, [SETTLED])
        simulation.import_state(sim, lifted(simulation.export_state(sim)))
        simulation.advance(sim, [SETTLED + FALL + SHARED])
        assert 0.2 < asleep(sim).mean() < 0.8
        return fingerprint(simulation.snapshot(sim, 0))

    same_in_teams(drowsy(1), LAWS, woken)
