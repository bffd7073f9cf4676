"""What grains and air do to each other: every sum closes, at any stiffness."""

from dataclasses import replace

import numpy as np
import pytest
from windy_beds import DENSITY, MASS, RADIUS, SIDE, VISCOSITY, air, weightless

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.effect import replica_effect
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.effects import load_library
from taichi_erosion.simulation import advance, air_profile, assemble, snapshot

STEP = 1e-5  # s, of grain_worlds
SPHERE = 4.0 / 3.0 * np.pi * RADIUS**3  # m3
FACES = np.linspace(0.0, 6e-3, 14)
PLACES = [(1e-3, 1e-3, 0.0), (3e-3, 5e-3, 2.1e-3), (6e-3, 2e-3, 3.37e-3), (6e-3, 6e-3, 6e-3)]
INTERVAL = 3  # steps between exchanges
STEPS = 70  # 23 exchanges and one step


def streaming(viscosity: float, density: float = DENSITY):
    """Grains at rest in air that moves as a block between a floor and a lid without stress."""
    over = air(FACES, "symmetry", density=density, viscosity=viscosity, start=np.full(len(FACES) - 1, 1.0))
    return weightless(PLACES, 0.0, over, look_steps=INTERVAL)


def with_more_drag(bare: Setup) -> Setup:
    """The same with the drag of grains on and near a bed."""
    effect = load_library()["near_wall_drag"]
    return replace(bare, effects=(replica_effect(effect, effect.params(), 1.0, {}, RADIUS),))


@pytest.fixture(scope="module")
def streams():
    """Velocities of air [steps, replica, layer] and grains [steps, replica, grain], step by step."""
    # rate of drag times the interval between exchanges: from 1e-3 to 1e5
    setups = [streaming(VISCOSITY * 10.0**k) for k in (2, 0, 2, 4, 6, 8)]
    setups[0] = with_more_drag(setups[0])
    sim = assemble(setups, Laws(), Numerics("cpu", 1, "f64"))
    wind, speed = [], []
    for step in range(1, STEPS + 1):
        advance(sim, [step * STEP] * len(setups))
        wind.append([air_profile(sim, r).velocity[:, 0] for r in range(len(setups))])
        speed.append([snapshot(sim, r).velocity[:, 0] for r in range(len(setups))])
    profiles = [air_profile(sim, r) for r in range(len(setups))]
    residual_momentum = sim.coupling.exchange.residual_momentum.to_numpy()[: len(setups), :, 0].sum(axis=1)
    drag_kick = sim.world.frozen_drag.drag_kick.to_numpy()[:, 0]
    rows = 2 * sim.capacities.grains
    side = sim.world.replicas.side.to_numpy()
    pending = [
        MASS * drag_kick[rows * r + int(side[r]) * sim.capacities.grains :][: len(PLACES)].sum()
        for r in range(len(setups))
    ]
    raw = [
        sim.world.grains.velocity.to_numpy()[rows * r + int(side[r]) * sim.capacities.grains :][
            : len(PLACES), 0
        ]
        for r in range(len(setups))
    ]
    stop_device()
    return np.array(wind), np.array(speed), profiles, residual_momentum - np.array(pending), np.array(raw)


def test_the_volume_of_every_grain_lies_in_the_layers_floor_and_lid_included(streams):
    _, _, profiles, _, _ = streams
    for profile in profiles:
        filled = ((1.0 - profile.void_fraction) * np.diff(profile.face)).sum() * SIDE**2
        assert filled == pytest.approx(len(PLACES) * SPHERE, rel=1e-12)


def test_momentum_of_air_and_grains_stays_at_any_stiffness(streams):
    wind, _, profiles, residual_momentum, raw = streams
    for replica, profile in enumerate(profiles):
        volume = profile.void_fraction * np.diff(profile.face) * SIDE**2
        now = (
            DENSITY * (volume * wind[-1, replica]).sum()
            + MASS * raw[replica].sum()
            + residual_momentum[replica]
        )
        # all of the air moved at 1 m/s; the first exchange deposits the grains and leaves out their volume
        assert now == pytest.approx(DENSITY * volume.sum(), rel=1e-12)


def test_drag_that_an_effect_adds_is_taken_from_the_air(streams):
    wind, speed, _, _, _ = streams
    # the grain on the floor gains more, and its layer of air loses more; that their sum stays is tested above
    assert np.all(speed[INTERVAL : 2 * INTERVAL, 0, 0] > 1.3 * speed[INTERVAL : 2 * INTERVAL, 2, 0])
    assert wind[2 * INTERVAL, 0, 0] < wind[2 * INTERVAL, 2, 0]


def test_drag_of_any_stiffness_neither_overshoots_nor_grows(streams):
    wind, speed, _, _, _ = streams
    assert np.all(np.isfinite(wind))
    assert np.all((wind > -1e-9) & (wind < 1.0 + 1e-9))
    assert np.all((speed > -1e-9) & (speed < 1.0 + 1e-9))


def test_the_stiffest_drag_brings_air_and_grains_to_one_velocity(streams):
    wind, speed, profiles, _, _ = streams
    volume = profiles[-1].void_fraction * np.diff(profiles[-1].face) * SIDE**2
    together = DENSITY * volume.sum() / (DENSITY * volume.sum() + len(PLACES) * MASS)
    # grains of mass m in air of mass M keep (m (n - 1)) / (m n + M) = 0.64 of the difference from an exchange
    # to the next, after n steps, and 0.64^23 = 4e-5
    assert speed[-1, -1] == pytest.approx(together, rel=1e-3)
    assert wind[-1, -1] == pytest.approx(together, rel=1e-3)


@pytest.mark.slow
def test_a_grain_far_heavier_than_its_air_relaxes_at_its_own_rate():
    place, density = (4e-3, 4e-3, 3e-3), 1e-3
    over = air(
        FACES, "symmetry", density=density, viscosity=10.0, start=np.full(len(FACES) - 1, 1.0), side=1.0
    )
    sim = assemble([weightless([place], 0.0, over, look_steps=1)], Laws(), Numerics("cpu", 1, "f64"))
    steps = 400
    advance(sim, [steps * STEP])
    state, profile = snapshot(sim, 0), air_profile(sim, 0)
    stop_device()
    rate = 6.0 * np.pi * density * 10.0 * RADIUS / MASS  # Stokes: Re = 1e-4
    want = 1.0 - np.exp(-rate * steps * STEP)
    # drag is implicit, of first order in b dt; the wide patch keeps its air
    assert rate * STEP < 2e-3
    assert state.velocity[0, 0] == pytest.approx(want * profile.velocity[6, 0], rel=5e-2)
