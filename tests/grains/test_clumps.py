"""Rigid clumps: free rotation conserves what it must, and spheres keep their places in the body."""

import numpy as np
import pytest
from few_grains import ARMS, FREE, INERTIA, equal_clumps
from grain_worlds import NONE, grains, setup
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from taichi_erosion.core.setup import Floats, Laws, Numerics, Setup
from taichi_erosion.simulation import advance, assemble, export_state, snapshot

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
POSE = Rotation.from_euler("xyz", [[0.3, -0.8, 1.2]])
SPIN = np.array([12.0, 60.0, -25.0])  # rad s-1
VELOCITY = np.array([0.1, -0.2, 0.05])  # m s-1
STEPS = (1e-4, 5e-5)  # s
DURATION = 0.1  # s, about a turn
START = POSE.apply(INERTIA * POSE.inv().apply(SPIN))[0]  # angular momentum [kg m2 s-1]


def flight(time_step: float) -> Setup:
    arms = POSE[0].apply(ARMS)
    spheres = grains(arms, VELOCITY + np.cross(SPIN, arms), SPIN)
    return setup(spheres, NONE, time_step=time_step, clumps=equal_clumps(np.zeros((1, 3)), POSE), **FREE)


def rotation_energy(momentum: Floats, pose: Rotation) -> float:
    return float(0.5 * (pose.inv().apply(momentum) ** 2 / INERTIA).sum())


def test_a_free_clump_flies_and_turns_as_a_rigid_body_with_two_time_steps():
    sim = assemble([flight(step) for step in STEPS], Laws(), Numerics("cpu", 1, "f64"))
    advance(sim, [DURATION] * len(STEPS))
    state, seen = export_state(sim), [snapshot(sim, r) for r in range(len(STEPS))]
    errors = []
    for r, spheres in enumerate(seen):
        momentum, pose = state[f"replica{r}_body_momentum"][0], state[f"replica{r}_body_orientation"]
        # no torque, no change: only the sum of the start is rounded
        assert momentum == pytest.approx(START, rel=1e-12)
        assert state[f"replica{r}_body_position"][0] == pytest.approx(VELOCITY * DURATION, rel=1e-9)
        assert pdist(spheres.position) == pytest.approx(pdist(ARMS), rel=1e-12)
        # v_i - v_j = w x (x_i - x_j) in rigid motion
        arms, speed = np.diff(spheres.position, axis=0), np.diff(spheres.velocity, axis=0)
        assert np.abs((arms * speed).sum(axis=1)).max() < 1e-12 * np.abs(arms).max() * np.abs(speed).max()
        turned = Rotation.from_quat(pose, scalar_first=True)
        errors.append(abs(rotation_energy(momentum, turned) / rotation_energy(START, POSE) - 1.0))
    assert errors[0] < 1e-3
    # second order, with a quarter of room for the next order
    assert errors[0] / errors[1] == pytest.approx((STEPS[0] / STEPS[1]) ** 2, rel=0.25)
