"""What grains and air do to each other: every sum closes, at any stiffness."""

import numpy as np
import pytest
from grain_worlds import MASS, RADIUS
from grain_worlds import TIME_STEP as STEP
from own_effects import acted_on
from windy_beds import DENSITY, SIDE, VISCOSITY, air, weightless

from taichi_erosion.core.setup import Laws, Numerics
from taichi_erosion.simulation import advance, air_profile, assemble, snapshot
from tests.verification.wind.exchange import grain_momentum

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
SPHERE = 4.0 / 3.0 * np.pi * RADIUS**3  # m3
FACES = np.linspace(0.0, 6e-3, 14)
BLOCK = np.ones(len(FACES) - 1)  # m s-1
PLACES = [(1e-3, 1e-3, 0.0), (3e-3, 5e-3, 2.1e-3), (6e-3, 2e-3, 3.37e-3), (6e-3, 6e-3, 6e-3)]
INTERVAL = 3  # steps between exchanges
STEPS = 70  # 23 exchanges and one step


@pytest.fixture(scope="module")
def streams():
    """Velocities of air [step, replica, layer] and grains [step, replica, grain], and how all end."""
    # grains at rest in air that moves as a block between a floor and a lid without stress; rate of drag times
    # the interval between exchanges: from 1e-3 to 1e5
    overs = [air(FACES, "symmetry", viscosity=VISCOSITY * 1e2**k, start=BLOCK) for k in (1, 0, 1, 2, 3, 4)]
    setups = [weightless(PLACES, over, INTERVAL) for over in overs]
    setups[0] = acted_on(setups[0], {}, near_wall_drag={})  # more drag of grains on and near a bed
    sim = assemble(setups, Laws(), Numerics("cpu", 1, "f64"))
    replicas, wind, speed = range(len(setups)), [], []
    for step in range(1, STEPS + 1):
        advance(sim, [step * STEP for _ in replicas])
        wind.append([air_profile(sim, r).velocity[:, 0] for r in replicas])
        speed.append([snapshot(sim, r).velocity[:, 0] for r in replicas])
    ends = [(air_profile(sim, r), grain_momentum(sim, r)) for r in replicas]
    return np.array(wind), np.array(speed), ends


def test_volume_and_momentum_of_air_and_grains_stay_at_any_stiffness(streams):
    for profile, grains in streams[2]:
        # all layers, floor and lid included, hold the volume of the grains
        filled = ((1.0 - profile.void_fraction) * np.diff(profile.face)).sum() * SIDE**2
        assert filled == pytest.approx(len(PLACES) * SPHERE, rel=1e-12)
        mass = DENSITY * profile.void_fraction * np.diff(profile.face) * SIDE**2
        now = (mass * profile.velocity[:, 0]).sum() + grains.moving[0] + grains.residual[0]
        # all of the air moved at 1 m/s; the first exchange deposits the grains and leaves out their volume
        assert now == pytest.approx(mass.sum(), rel=1e-12)


def test_drag_that_an_effect_adds_is_taken_from_the_air(streams):
    wind, speed, _ = streams
    # the grain on the floor gains more, and its layer of air loses more; that their sum stays is tested above
    assert np.all(speed[INTERVAL : 2 * INTERVAL, 0, 0] > 1.3 * speed[INTERVAL : 2 * INTERVAL, 2, 0])
    assert wind[2 * INTERVAL, 0, 0] < wind[2 * INTERVAL, 2, 0]


def test_drag_of_any_stiffness_neither_overshoots_nor_grows(streams):
    wind, speed, _ = streams
    for velocity in (wind, speed):
        assert np.all((velocity > -1e-9) & (velocity < 1.0 + 1e-9))


def test_the_stiffest_drag_brings_air_and_grains_to_one_velocity(streams):
    wind, speed, ends = streams
    volume = ends[-1][0].void_fraction * np.diff(ends[-1][0].face) * SIDE**2
    together = DENSITY * volume.sum() / (DENSITY * volume.sum() + len(PLACES) * MASS)
    # grains of mass m in air of mass M keep (m (n - 1)) / (m n + M) = 0.64 of the difference from an exchange
    # to the next, after n steps, and 0.64^23 = 4e-5
    assert speed[-1, -1] == pytest.approx(together, rel=1e-3)
    assert wind[-1, -1] == pytest.approx(together, rel=1e-3)
