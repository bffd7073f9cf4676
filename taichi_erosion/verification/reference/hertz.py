"""Head-on Hertz impacts in closed form, and the moduli that they start from.

K = (4/3) E* sqrt(R*) [N m^-1.5] stores (2/5) K d^2.5 = m* v^2 / 2 at the deepest overlap.

Reference: Johnson (1985), Contact Mechanics, eqs (11.20)-(11.24); Chung & Ooi (2011), Granular Matter 13,
643.
"""

from dataclasses import dataclass
from math import log, pi, sqrt

DURATION_FACTOR = (
    2.9432751843  # contact time, speed over peak overlap: 4 sqrt(pi) Gamma(2/5) / (5 Gamma(9/10)) [1]
)


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
    def force_peak(self) -> float:
        """K d_max^1.5 [N]."""
        return self.stiffness * self.overlap_peak**1.5

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
