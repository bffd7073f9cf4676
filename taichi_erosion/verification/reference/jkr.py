"""JKR contact in closed form, with gamma the surface energy of each surface (work of adhesion 2 gamma).

With L = (pi gamma R*^2 / E*)^(1/3) and contact radius a = L s^2,

    d R*/L^2 = s^4 - 2 s,    F = (4/3) pi gamma R* s^3 (s^3 - 3).

Every landmark below is a value of s^3. The work from first touch (s^3 = 2) to the tear (s^3 = 1/2) is (4/3)
[0.4 s^10 - 2 s^7 + 1.5 s^4] between them, 3.34129 pi gamma L^2; an impact without other losses sticks below
the speed whose energy this is.

Reference: Johnson, Kendall & Roberts (1971), Proc. R. Soc. A 324, 301; Thornton & Ning (1998), Powder
Technology 99, 154.
"""

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root_scalar

Floats = NDArray[np.float64]

CUBE_PULL_OFF = 1.5  # s^3 where dF/ds = 0 [1]
CUBE_BALANCE = 3.0  # s^3 where F = 0 [1]
CUBE_TOUCH = 2.0  # s^3 where d = 0 [1]
CUBE_TEAR = 0.5  # s^3 where dd/ds = 0 [1]
WORK_LOST = 3.3412907  # of pi gamma L^2: from touch to tear [1]


@dataclass(frozen=True)
class Sticky:
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


def force(pair: Sticky, overlap: Floats) -> Floats:
    """F [N] at the given overlaps [m], on the stable branch (the force of an engaged contact)."""
    return np.array([branch_force(d / pair.depth) for d in overlap]) * pair.force_scale


def branch_force(reduced: float) -> float:
    """F/(pi gamma R*) at d R*/L^2, zero past the tear; s is bracketed, not found by Newton's rule."""
    lowest = CUBE_TEAR ** (1.0 / 3.0)
    if reduced < overlap_at(CUBE_TEAR):
        return 0.0
    highest = 2.0 + abs(reduced)
    found = root_scalar(lambda s: s**4 - 2.0 * s - reduced, bracket=(lowest, highest), xtol=1e-15, rtol=1e-14)
    return force_at(found.root**3)
