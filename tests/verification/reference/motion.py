"""Motion of spheres: sliding and rolling in closed form; bouncing and a stacked pair integrated by SciPy.

Sliding and rolling on a plane follow rigid-body mechanics, moment of inertia (2/5) m R^2. MFiX-DEM's cases
DEM02 (a bouncing grain) and DEM03 (two stacked grains between walls) use a linear spring; here the same
scenes have the Hertz spring with the damping of this program (restitution independent of speed),

    F = (4/3) E* sqrt(R*) d^1.5 + 2 sqrt(5/6) beta sqrt(2 E* a m*) dd/dt,    d > 0, a = sqrt(R* d),

so DEM02's heights h_k = (h_0 - r) e^(2k) + r stay exact for an infinitely stiff grain, and DEM03's pair of
linear equations becomes a pair of nonlinear ones without a closed form.

Reference: LAMMPS `unittest/granular` analytic models; MFiX-DEM verification manual, cases DEM02, DEM03 and
DEM04; Garg et al. (2012), Powder Technology 220, 122; Zhou et al. (2002), Powder Technology 125, 45 (constant
rolling torque).
"""

from dataclasses import dataclass
from functools import partial
from math import cos, sin, tan

import numpy as np
from scipy.integrate import solve_ivp

from taichi_erosion.core.setup import Floats
from tests.verification.reference.contact import damping_ratio

GRAVITY = 9.81  # m s-2


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
    """Spin decay in place on a smooth plane by the torque mu_r R N [rad s-2], 5 mu_r g / (2 R)."""
    return 2.5 * friction_rolling * GRAVITY / radius


integrate = partial(solve_ivp, method="DOP853")
DAMPING_FACTOR = 2.0 * np.sqrt(5.0 / 6.0)  # makes e independent of speed for Hertz stiffness [1]


@dataclass(frozen=True)
class Spring:
    """One Hertz contact."""

    young: float  # E*, Pa
    radius: float  # R*, m
    mass: float  # m*, kg
    restitution: float

    def push(self, overlap: float, rate: float) -> float:
        """Force that separates the bodies [N]; `rate` is the growth of the overlap [m s-1]."""
        if overlap <= 0.0:
            return 0.0
        contact_radius = np.sqrt(self.radius * overlap)
        dashpot = np.sqrt(2.0 * self.young * contact_radius * self.mass)
        damping = DAMPING_FACTOR * damping_ratio(self.restitution) * dashpot
        return 4.0 / 3.0 * self.young * contact_radius * overlap + damping * rate


@dataclass(frozen=True)
class Stack:
    """Two equal spheres between a floor at 0 and a lid at `height`."""

    radius: float  # m
    masses: tuple[float, float]  # kg, lower and upper
    height: float  # m
    floor: Spring
    middle: Spring
    lid: Spring
    gravity: float  # m s-2


def bounce_heights(drop: float, restitution: float, bounces: int) -> Floats:
    """Heights of the lowest point after each bounce of an infinitely stiff grain [m], (h_0 - r) e^(2k)."""
    return np.array([drop * restitution ** (2.0 * bounce) for bounce in range(1, bounces + 1)])


def stacked_motion(stack: Stack, start: tuple[float, float], times: Floats) -> Floats:
    """Heights of both centres [times, 2] in m, released at rest from `start`."""

    def rates(_: float, state: Floats) -> list[float]:
        low, high, low_speed, high_speed = state
        floor = stack.floor.push(stack.radius - low, -low_speed)
        middle = stack.middle.push(2.0 * stack.radius - (high - low), low_speed - high_speed)
        lid = stack.lid.push(high + stack.radius - stack.height, high_speed)
        lower = (floor - middle) / stack.masses[0] - stack.gravity
        upper = (middle - lid) / stack.masses[1] - stack.gravity
        return [low_speed, high_speed, lower, upper]

    # contacts open and close: a short longest step keeps the step control from stepping over them
    solution = integrate(
        rates,
        (0.0, times[-1]),
        [*start, 0.0, 0.0],
        t_eval=times,
        rtol=1e-9,
        atol=1e-13,
        max_step=times[-1] / 2000.0,
    )
    return solution.y[:2].T


def rebound_speed(spring: Spring, speed: float, gravity: float) -> float:
    """Speed [m s-1] at which a grain that touches the floor at `speed` leaves it, pressed by its weight."""

    def rates(_: float, state: Floats) -> list[float]:
        return [state[1], gravity - spring.push(state[0], state[1]) / spring.mass]

    # the elastic contact lasts 2.87 of this unit, the damped one (e >= 0.5) less than twice as long
    unit = (spring.mass**2 / (spring.radius * spring.young**2 * speed)) ** 0.2
    solution = integrate(
        rates,
        (0.0, 8.0 * unit),
        [0.0, speed],
        events=lambda _, state: state[0],
        rtol=1e-9,
        atol=1e-14,
        max_step=unit / 50.0,
    )
    crossings = np.asarray(solution.y_events[0])
    return float(-crossings[crossings[:, 1] < 0.0][0, 1])


def hertz_motion(stiffness: float, mass: float, speed: float, duration: float) -> float:
    """Overlap [m] that an undamped Hertz contact has reached `duration` after touching at `speed`."""
    solution = integrate(
        lambda _, state: [state[1], -stiffness / mass * max(state[0], 0.0) ** 1.5],
        (0.0, duration),
        [0.0, speed],
        rtol=1e-13,
        atol=1e-18,
        max_step=duration / 500.0,
    )
    return float(solution.y[0, -1])
