"""Rigid clumps: free rotation conserves what it must, and spheres keep their places in the body."""

from dataclasses import dataclass

import numpy as np
import pytest
from grain_worlds import MASS, NONE, RADIUS, grains, setup
from scipy.spatial.transform import Rotation

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import ClumpTable, Floats, Laws, Numerics, Setup
from taichi_erosion.simulation import advance, assemble, export_state, snapshot

INERTIA = np.array([0.6, 1.0, 1.5]) * MASS * (2.0 * RADIUS) ** 2  # kg m2, three different principal moments
OFFSET = np.array([[1.2, 0.0, 0.1], [-0.9, 0.7, 0.0], [-0.3, -0.7, -0.1]]) * RADIUS
POSE = Rotation.from_euler("xyz", [0.3, -0.8, 1.2])
SPIN = np.array([12.0, 60.0, -25.0])  # rad s-1
VELOCITY = np.array([0.1, -0.2, 0.05])  # m s-1
STEPS = (1e-4, 5e-5)  # s
DURATION = 0.1  # s, about a turn


@dataclass(frozen=True)
class End:
    """What is left of a free flight."""

    momentum: Floats  # kg m2 s-1
    energy: float  # J, of rotation
    spheres: Floats  # [3, 3] m
    velocities: Floats  # [3, 3] m s-1
    centre: Floats  # m


def flight(time_step: float) -> Setup:
    arms = POSE.apply(OFFSET)
    table = ClumpTable(
        body=np.zeros(3, np.int32),
        offset=OFFSET,
        mass=np.array([3.0 * MASS]),
        inertia=INERTIA[None],
        position=np.zeros((1, 3)),
        orientation=POSE.as_quat(scalar_first=True)[None],
    )
    spheres = grains(arms, VELOCITY + np.cross(SPIN, arms), SPIN)
    return setup(spheres, NONE, gravity=(0.0, 0.0, 0.0), time_step=time_step, clumps=table)


def rotation_energy(momentum: Floats, pose: Rotation) -> float:
    own = pose.inv().apply(momentum)
    return float(0.5 * (own**2 / INERTIA).sum())


START = POSE.apply(INERTIA * POSE.inv().apply(SPIN))


@pytest.fixture(scope="module")
def ends() -> list[End]:
    """The same free flight with two time steps."""
    sim = assemble([flight(step) for step in STEPS], Laws(), Numerics("cpu", 1, "f64"))
    advance(sim, [DURATION] * len(STEPS))
    state = export_state(sim)
    found = []
    for r in range(len(STEPS)):
        momentum = state[f"replica{r}_body_momentum"][0]
        pose = Rotation.from_quat(state[f"replica{r}_body_orientation"][0], scalar_first=True)
        seen = snapshot(sim, r)
        centre = state[f"replica{r}_body_position"][0]
        energy = rotation_energy(momentum, pose)
        found.append(End(momentum, energy, seen.position, seen.velocity, centre))
    stop_device()
    return found


def test_a_free_clump_starts_and_stays_with_its_angular_momentum(ends):
    # no torque, no change: only the sum of the start is rounded
    for end in ends:
        assert end.momentum == pytest.approx(START, rel=1e-12)


def test_the_energy_of_free_rotation_errs_with_the_square_of_the_time_step(ends):
    start = rotation_energy(START, POSE)
    coarse, fine = (abs(end.energy / start - 1.0) for end in ends)
    assert coarse < 1e-3
    # second order, with a quarter of room for the next order
    assert coarse / fine == pytest.approx((STEPS[0] / STEPS[1]) ** 2, rel=0.25)


def test_the_spheres_of_a_clump_keep_their_distances(ends):
    pairs = np.array([[0, 1], [0, 2], [1, 2]])
    want = np.linalg.norm(OFFSET[pairs[:, 0]] - OFFSET[pairs[:, 1]], axis=1)
    for end in ends:
        apart = np.linalg.norm(end.spheres[pairs[:, 0]] - end.spheres[pairs[:, 1]], axis=1)
        assert apart == pytest.approx(want, rel=1e-12)


def test_the_centre_of_a_free_clump_moves_straight_on(ends):
    for end in ends:
        assert end.centre == pytest.approx(VELOCITY * DURATION, rel=1e-9)


def test_the_spheres_move_as_one_rigid_body(ends):
    # v_i - v_j is perpendicular to x_i - x_j in rigid motion
    for end in ends:
        for i, j in ((0, 1), (0, 2), (1, 2)):
            apart, speed = end.spheres[i] - end.spheres[j], end.velocities[i] - end.velocities[j]
            assert abs(apart @ speed) < 1e-12 * np.linalg.norm(SPIN) * RADIUS**2 * 10.0
