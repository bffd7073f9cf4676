"""Spheres that slide and roll on a plane: closed forms of rigid-body mechanics, moment of inertia (2/5) m
R^2.

Reference: LAMMPS `unittest/granular` analytic models; MFiX-DEM verification manual, case DEM04; Zhou et al.
(2002), Powder Technology 125, 45 (constant rolling torque).
"""

from math import cos, sin, tan

GRAVITY = 9.81  # m s-2


def slide_time(speed: float, friction: float) -> float:
    """When a sphere that starts sliding without spin begins to roll [s], 2 u_0 / (7 mu g)."""
    return 2.0 * speed / (7.0 * friction * GRAVITY)


def rolling_speed(speed: float) -> float:
    """Speed from then on [m s-1], (5/7) u_0."""
    return 5.0 / 7.0 * speed


def friction_for_rolling(slope: float) -> float:
    """Least sliding friction with which a sphere rolls down a slope [rad] without slipping, (2/7) tan."""
    return 2.0 / 7.0 * tan(slope)


def rolling_acceleration(slope: float, friction_rolling: float = 0.0) -> float:
    """(5/7) g (sin - mu_r cos) [m s-2], a sphere that rolls without slipping against the torque mu_r R N."""
    return 5.0 / 7.0 * GRAVITY * (sin(slope) - friction_rolling * cos(slope))


def sliding_acceleration(slope: float, friction: float) -> float:
    """G (sin - mu cos) [m s-2]."""
    return GRAVITY * (sin(slope) - friction * cos(slope))


def sliding_spin_up(slope: float, friction: float, radius: float) -> float:
    """(5/2) mu g cos / R [rad s-2]."""
    return 2.5 * friction * GRAVITY * cos(slope) / radius


def spin_decay(friction_rolling: float, radius: float) -> float:
    """Rate at which the torque mu_r R N stops a sphere that spins in place on a smooth plane [rad s-2], 5
    mu_r g / (2 R).
    """
    return 2.5 * friction_rolling * GRAVITY / radius
