"""Bouncing grains and a stacked pair, integrated by SciPy.

MFiX-DEM's cases DEM02 (a bouncing grain) and DEM03 (two stacked grains between walls) use a linear spring;
here they have the Hertz spring with a damping whose restitution does not depend on speed,

    F = (4/3) E* sqrt(R*) d^1.5 + 2 sqrt(5/6) beta sqrt(2 E* a m*) dd/dt,    d > 0, a = sqrt(R* d),

so DEM02's heights h_k = (h_0 - r) e^(2k) + r stay exact for an infinitely stiff grain.

Reference: LAMMPS `unittest/granular` analytic models; MFiX-DEM verification manual, cases DEM02, DEM03 and
DEM04; Garg et al. (2012), Powder Technology 220, 122; Zhou et al. (2002), Powder Technology 125, 45 (constant
rolling torque).
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.integrate import solve_ivp

from taichi_erosion.core.setup import Floats
from tests.verification.reference.contact import DAMPING_FACTOR, damping_ratio

GRAVITY = 9.81  # m s-2
integrate = partial(solve_ivp, method="DOP853")


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


def stacked_motion(
    floor: Spring, middle: Spring, lid: Spring, height: float, start: tuple[float, float], times: Floats
) -> Floats:
    """Heights of two equal spheres between a floor at 0 and a lid [m], [times, 2].

    They are released at rest from `start` [m]; masses are those of the contacts with floor and lid.
    """

    def rates(_: float, state: Floats) -> list[float]:
        low, high, low_speed, high_speed = state
        below = floor.push(floor.radius - low, -low_speed)
        between = middle.push(2.0 * floor.radius - (high - low), low_speed - high_speed)
        above = lid.push(high + floor.radius - height, high_speed)
        lower = (below - between) / floor.mass - GRAVITY
        upper = (between - above) / lid.mass - GRAVITY
        return [low_speed, high_speed, lower, upper]

    # contacts open and close: a short longest step keeps the step control from stepping over them
    fine = {"rtol": 1e-9, "atol": 1e-13, "max_step": times[-1] / 2000.0}
    return integrate(rates, (0.0, times[-1]), [*start, 0.0, 0.0], t_eval=times, **fine).y[:2].T


def rebound_speed(spring: Spring, speed: float) -> float:
    """Speed [m s-1] at which a grain that touches the floor at `speed` leaves it, pressed by its weight."""

    def rates(_: float, state: Floats) -> list[float]:
        return [state[1], GRAVITY - spring.push(state[0], state[1]) / spring.mass]

    # the elastic contact lasts 2.87 of this unit, the damped one (e >= 0.5) less than twice as long
    unit = (spring.mass**2 / (spring.radius * spring.young**2 * speed)) ** 0.2
    fine = {"rtol": 1e-9, "atol": 1e-14, "max_step": unit / 50.0}
    solution = integrate(rates, (0.0, 8.0 * unit), [0.0, speed], events=lambda _, state: state[0], **fine)
    crossings = np.asarray(solution.y_events[0])
    return float(-crossings[crossings[:, 1] < 0.0][0, 1])


def hertz_motion(stiffness: float, mass: float, speed: float, duration: float) -> float:
    """Overlap [m] that an undamped Hertz contact has reached `duration` after touching at `speed`."""

    def rates(_: float, state: Floats) -> list[float]:
        return [state[1], -stiffness / mass * max(state[0], 0.0) ** 1.5]

    fine = {"rtol": 1e-13, "atol": 1e-18, "max_step": duration / 500.0}
    return float(integrate(rates, (0.0, duration), [0.0, speed], **fine).y[0, -1])
