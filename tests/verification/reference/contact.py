"""Contact of spheres written a second time: Hertz impact, JKR adhesion, oblique impact, bounces and a stack.

Hertz: `taichi_erosion.verification.closed_forms.hertz_impact`.

Reference: Johnson (1985), Contact Mechanics, eqs (11.20)-(11.24); Chung & Ooi (2011), Granular Matter 13,
643.

JKR, with gamma the surface energy of each surface (work of adhesion 2 gamma), L = (pi gamma R*^2 / E*)^(1/3)
and contact radius a = L s^2:

    d R*/L^2 = s^4 - 2 s,    F = (4/3) pi gamma R* s^3 (s^3 - 3).

Every landmark below is a value of s^3. The work from first touch (s^3 = 2) to the tear (s^3 = 1/2) is (4/3)
[0.4 s^10 - 2 s^7 + 1.5 s^4] between them, 3.34129 pi gamma L^2; an impact without other losses sticks below
the speed whose energy this is.

Reference: Johnson, Kendall & Roberts (1971), Proc. R. Soc. A 324, 301; Thornton & Ning (1998), Powder
Technology 99, 154.

Oblique impact of a sphere on a rigid plane, integrated with a fine step:

    m dv_n/dt = (4/3) E* sqrt(R) d^1.5 - c_n v_n,   c_n = 2 sqrt(5/6) beta sqrt(2 E* a m),   a = sqrt(R d)
    F_t = -8 G* a xi - c_t v_s,   |F_t| <= mu F_cap,   c_t = 2 sqrt(5/6) beta sqrt(8 G* a m)

v_s = v_t + R omega is the slip and xi its integral over the contact (total form, no slip); the lever arm is
R. The spring alone is limited by the cap, and the dashpot is left out while it slides, so that gross sliding
is exact for every e. F_cap is the elastic force, as in `grains/contact.py`.
Vectorised over impacts; leapfrog with `steps` per elastic contact time.

Reference: Tsuji et al. (1992), Powder Technology 71, 239, with Mindlin's no-slip stiffness.

MFiX-DEM's cases DEM02 (a bouncing grain) and DEM03 (two stacked grains between walls) use a linear spring;
here SciPy integrates them with the Hertz spring and a damping whose restitution does not depend on speed,

    F = (4/3) E* sqrt(R*) d^1.5 + 2 sqrt(5/6) beta sqrt(2 E* a m*) dd/dt,    d > 0, a = sqrt(R* d),

so DEM02's heights h_k = (h_0 - r) e^(2k) + r stay exact for an infinitely stiff grain.

Reference: MFiX-DEM verification manual; Garg et al. (2012), Powder Technology 220, 122; Zhou et al. (2002),
Powder Technology 125, 45 (constant rolling torque).
"""

from dataclasses import dataclass
from functools import partial
from math import log, pi, sqrt

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root_scalar

from taichi_erosion.core.setup import Floats
from taichi_erosion.verification.closed_forms import DURATION_FACTOR


@dataclass(frozen=True)
class Solid:
    """An isotropic elastic solid."""

    young: float  # Pa
    poisson: float  # 1
    density: float  # kg m-3

    @property
    def shear(self) -> float:
        """G = E / (2 (1 + nu)) [Pa]."""
        return self.young / (2.0 * (1.0 + self.poisson))


def effective_moduli(*solids: Solid) -> tuple[float, float]:
    """E* and G* of one or two solids [Pa]; of one, the partner is rigid.

    1/E* = sum (1 - nu^2) / E,    1/G* = sum (2 - nu) / G
    """
    normal = sum((1.0 - solid.poisson**2) / solid.young for solid in solids)
    return 1.0 / normal, 1.0 / sum((2.0 - solid.poisson) / solid.shear for solid in solids)


def damping_ratio(restitution: float) -> float:
    """Beta = -ln e / sqrt(ln^2 e + pi^2) [1]."""
    return -log(restitution) / sqrt(log(restitution) ** 2 + pi**2)


def series(first: float, second: float) -> float:
    """1/(1/a + 1/b): effective radius of two spheres, or reduced mass."""
    return first * second / (first + second)


CUBE_PULL_OFF = 1.5  # s^3 where dF/ds = 0 [1]
CUBE_BALANCE = 3.0  # s^3 where F = 0 [1]
CUBE_TEAR = 0.5  # s^3 where dd/ds = 0 [1]
WORK_LOST = 3.3412907  # of pi gamma L^2: from touch to tear [1]


@dataclass(frozen=True)
class AdhesivePair:
    young: float  # E*, Pa
    radius: float  # R*, m
    mass: float  # m*, kg
    energy: float  # gamma, J m-2

    @property
    def length(self) -> float:
        """L [m]."""
        return (pi * self.energy * self.radius**2 / self.young) ** (1.0 / 3.0)

    @property
    def depth(self) -> float:
        """L^2/R*, the scale of the overlap [m]."""
        return self.length**2 / self.radius

    @property
    def force_scale(self) -> float:
        """Pi gamma R* [N]."""
        return pi * self.energy * self.radius

    @property
    def work_lost(self) -> float:
        return WORK_LOST * pi * self.energy * self.length**2

    @property
    def speed_sticking(self) -> float:
        """Approach speed below which the bodies stick [m s-1], sqrt(2 W / m*)."""
        return sqrt(2.0 * self.work_lost / self.mass)


def overlap_at(cube: float) -> float:
    """D R*/L^2 at s^3 = `cube`."""
    root = cube ** (1.0 / 3.0)
    return cube * root - 2.0 * root


def branch_force(reduced: float) -> float:
    """F/(pi gamma R*) at d R*/L^2, zero past the tear; s is bracketed, not found by Newton's rule."""
    lowest = CUBE_TEAR ** (1.0 / 3.0)
    if reduced < overlap_at(CUBE_TEAR):
        return 0.0
    highest = 2.0 + abs(reduced)
    found = root_scalar(lambda s: s**4 - 2.0 * s - reduced, bracket=(lowest, highest), xtol=1e-15, rtol=1e-14)
    return 4.0 / 3.0 * found.root**3 * (found.root**3 - 3.0)


DAMPING_FACTOR = 2.0 * np.sqrt(5.0 / 6.0)  # makes e independent of speed for Hertz stiffness [1]
LEAST = 1e-300  # keeps the spring of a contact of no depth finite [N m-1]


@dataclass(frozen=True)
class Impact:
    """Impacts of one kind of sphere; `normal`, `tangential` and `spin` have one entry per impact."""

    young: float  # E*, Pa
    shear: float  # G*, Pa
    restitution: float
    friction: float
    radius: float  # m
    mass: float  # kg
    normal: Floats  # m s-1, towards the plane
    tangential: Floats  # m s-1
    spin: Floats  # rad s-1, positive where it adds to the slip


@dataclass(frozen=True)
class Rebound:
    """State after the contact; `normal` is positive away from the plane."""

    normal: Floats  # m s-1
    tangential: Floats  # m s-1
    spin: Floats  # rad s-1


def rebound(impact: Impact, steps: int = 20_000) -> Rebound:
    """Velocities and spin after the impact.

    Only the spring of friction is limited; its dashpot acts while the contact sticks.
    """
    hertz = 4.0 / 3.0 * impact.young * np.sqrt(impact.radius)
    deepest = (5.0 * impact.mass * impact.normal**2 / (4.0 * hertz)) ** 0.4
    step = DURATION_FACTOR * deepest / impact.normal / steps
    closing, tangential, spin = impact.normal + 0.0, impact.tangential + 0.0, impact.spin + 0.0
    overlap, spring = np.zeros_like(step), np.zeros_like(step)
    viscous = DAMPING_FACTOR * damping_ratio(impact.restitution)
    touches = np.ones(step.shape, bool)
    while touches.any():
        slip_speed = tangential + impact.radius * spin
        overlap += step * touches * closing
        spring += step * touches * slip_speed
        touches &= overlap > 0.0
        move = step * touches
        depth = np.maximum(overlap, 0.0)
        radius = np.sqrt(impact.radius * depth)  # of the contact
        elastic = 4.0 / 3.0 * impact.young * radius * depth
        normal = elastic + viscous * np.sqrt(2.0 * impact.young * radius * impact.mass) * closing
        stiffness = 8.0 * impact.shear * radius
        limit = impact.friction * elastic
        pull = stiffness * spring
        slides = np.abs(pull) > limit
        dashpot = viscous * np.sqrt(stiffness * impact.mass) * slip_speed
        friction = -np.where(slides, np.clip(pull, -limit, limit), pull + dashpot)
        spring = np.where(slides, -friction / np.maximum(stiffness, LEAST), spring)
        closing -= move / impact.mass * normal
        tangential += move / impact.mass * friction
        spin += move * friction * impact.radius / (0.4 * impact.mass * impact.radius**2)
    return Rebound(-closing, tangential, spin)


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
        return [low_speed, high_speed, lower, ((between - above) / lid.mass - GRAVITY)]

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

    step = duration / 500.0
    end = integrate(rates, (0.0, duration), [0.0, speed], rtol=1e-13, atol=1e-18, max_step=step)
    return float(end.y[0, -1])
