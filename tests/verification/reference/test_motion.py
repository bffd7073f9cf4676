"""References of motion against rigid-body mechanics and limits."""

from math import radians

import pytest

from tests.verification.reference import motion


def test_sliding_and_rolling_accelerations_meet_at_the_critical_friction() -> None:
    slope = radians(30.0)
    critical = motion.friction_for_rolling(slope)
    assert motion.sliding_acceleration(slope, critical) == pytest.approx(motion.rolling_acceleration(slope))
    assert motion.sliding_spin_up(slope, critical, 1.0) == pytest.approx(motion.rolling_acceleration(slope))


def test_a_weightless_damped_impact_returns_the_restitution_asked_for() -> None:
    spring = motion.Spring(young=1e8, radius=0.1, mass=10.0, restitution=0.5)
    assert motion.rebound_speed(spring, 2.0, 0.0) / 2.0 == pytest.approx(0.5, abs=2e-5)


def test_weight_costs_a_damped_bounce_some_height() -> None:
    spring = motion.Spring(young=1e8, radius=0.1, mass=10.0, restitution=0.5)
    assert motion.rebound_speed(spring, 2.0, 9.81) < motion.rebound_speed(spring, 2.0, 0.0)
