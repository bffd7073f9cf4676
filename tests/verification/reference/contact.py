"""Contact of spheres written a second time: head-on Hertz impact, JKR adhesion, oblique impact.

Hertz: K = (4/3) E* sqrt(R*) [N m^-1.5] stores (2/5) K d^2.5 = m* v^2 / 2 at the deepest overlap.

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
"""

from dataclasses import dataclass
from math import log, pi, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root_scalar

from taichi_erosion.core.setup import Floats

# contact time times speed over peak overlap: 4 sqrt(pi) Gamma(2/5) / (5 Gamma(9/10)) [1]
DURATION_FACTOR = 2.9432751843


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


def young_effective(first: Solid, second: Solid | None) -> float:
    """1/E* = (1 - nu_1^2)/E_1 + (1 - nu_2^2)/E_2 [Pa]; without a second solid the partner is rigid."""
    compliance = (1.0 - first.poisson**2) / first.young
    if second is not None:
        compliance += (1.0 - second.poisson**2) / second.young
    return 1.0 / compliance


def shear_effective(first: Solid, second: Solid | None) -> float:
    """1/G* = (2 - nu_1)/G_1 + (2 - nu_2)/G_2 [Pa]; without a second solid the partner is rigid."""
    compliance = (2.0 - first.poisson) / first.shear
    if second is not None:
        compliance += (2.0 - second.poisson) / second.shear
    return 1.0 / compliance


@dataclass(frozen=True)
class HeadOn:
    """Two bodies that meet head-on; a rigid wall has infinite mass and radius."""

    young: float  # E*, Pa
    radius: float  # R*, m
    mass: float  # m*, kg
    speed: float  # of approach, m s-1

    @property
    def stiffness(self) -> float:
        """K [N m^-1.5]."""
        return 4.0 / 3.0 * self.young * sqrt(self.radius)

    @property
    def overlap_peak(self) -> float:
        """(5 m* v^2 / (4 K))^(2/5) [m]."""
        return (5.0 * self.mass * self.speed**2 / (4.0 * self.stiffness)) ** 0.4

    @property
    def duration(self) -> float:
        """Contact time of the elastic impact [s]."""
        return DURATION_FACTOR * self.overlap_peak / self.speed


def damping_ratio(restitution: float) -> float:
    """Beta = -ln e / sqrt(ln^2 e + pi^2) [1]."""
    return -log(restitution) / sqrt(log(restitution) ** 2 + pi**2)


def sphere_mass(radius: float, density: float) -> float:
    """Mass of a solid sphere [kg]."""
    return 4.0 / 3.0 * pi * radius**3 * density


def series(first: float, second: float) -> float:
    """1/(1/a + 1/b): effective radius of two spheres, or reduced mass."""
    return first * second / (first + second)


CUBE_PULL_OFF = 1.5  # s^3 where dF/ds = 0 [1]
CUBE_BALANCE = 3.0  # s^3 where F = 0 [1]
CUBE_TEAR = 0.5  # s^3 where dd/ds = 0 [1]
WORK_LOST = 3.3412907  # of pi gamma L^2: from touch to tear [1]


@dataclass(frozen=True)
class AdhesivePair:
    """Two adhesive bodies."""

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
        """Energy that a bounce costs [J]."""
        return WORK_LOST * pi * self.energy * self.length**2

    @property
    def speed_sticking(self) -> float:
        """Approach speed below which the bodies stick [m s-1], sqrt(2 W / m*)."""
        return sqrt(2.0 * self.work_lost / self.mass)


def force_at(cube: float) -> float:
    """F/(pi gamma R*) at s^3 = `cube`."""
    return 4.0 / 3.0 * cube * (cube - 3.0)


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
    return force_at(found.root**3)


DAMPING_FACTOR = 2.0 * np.sqrt(5.0 / 6.0)  # makes e independent of speed for Hertz stiffness [1]
LEAST = 1e-300  # keeps the spring of a contact of no depth finite [N m-1]
LONGEST = 3.0  # contact times after which an impact must be over [1]


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


@dataclass
class Contact:
    """What evolves during the contact."""

    overlap: Floats
    closing: Floats
    tangential: Floats
    spin: Floats
    spring: Floats
    open: NDArray[np.bool_]


def rebound(impact: Impact, steps: int = 20_000) -> Rebound:
    """Velocities and spin after the impact."""
    stiffness = 4.0 / 3.0 * impact.young * np.sqrt(impact.radius)
    depth = (5.0 * impact.mass * impact.normal**2 / (4.0 * stiffness)) ** 0.4
    step = DURATION_FACTOR * depth / impact.normal / steps
    state = Contact(
        overlap=np.zeros_like(step),
        closing=impact.normal + 0.0,
        tangential=impact.tangential + 0.0,
        spin=impact.spin + 0.0,
        spring=np.zeros_like(step),
        open=np.ones(step.shape, bool),
    )
    for _ in range(int(LONGEST * steps)):
        if state.open.any():
            advance(impact, state, step)
    return Rebound(-state.closing, state.tangential, state.spin)


def advance(impact: Impact, state: Contact, step: Floats) -> None:
    """One leapfrog step of every impact that still touches."""
    move = np.where(state.open, step, 0.0)
    slip_speed = state.tangential + impact.radius * state.spin
    state.overlap += move * state.closing
    state.spring += move * slip_speed
    state.open &= state.overlap > 0.0
    move = np.where(state.open, step, 0.0)
    depth = np.maximum(state.overlap, 0.0)
    contact_radius = np.sqrt(impact.radius * depth)
    viscous = DAMPING_FACTOR * damping_ratio(impact.restitution)
    elastic = 4.0 / 3.0 * impact.young * contact_radius * depth
    normal = elastic + viscous * np.sqrt(2.0 * impact.young * contact_radius * impact.mass) * state.closing
    stiffness = 8.0 * impact.shear * contact_radius
    dashpot = viscous * np.sqrt(stiffness * impact.mass) * slip_speed
    friction, spring = limited_friction(stiffness, state.spring, dashpot, impact.friction * elastic)
    state.spring = np.where(state.open, spring, state.spring)
    state.closing -= move / impact.mass * normal
    state.tangential += move / impact.mass * friction
    state.spin += move * friction * impact.radius / (0.4 * impact.mass * impact.radius**2)


def limited_friction(
    stiffness: Floats, spring: Floats, dashpot: Floats, limit: Floats
) -> tuple[Floats, Floats]:
    """Friction [N] and spring [m] after it; the spring alone is limited, the dashpot acts while it sticks."""
    elastic = -stiffness * spring
    slides = np.abs(elastic) > limit
    force = np.where(slides, np.clip(elastic, -limit, limit), elastic - dashpot)
    return force, np.where(slides, -force / np.maximum(stiffness, LEAST), spring)
