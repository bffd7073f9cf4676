"""Published formulas of aeolian transport: thresholds over diameter, flux over friction velocity.

Fluid threshold, at which wind moves a bed at rest, with s = rho_s / rho:

    Bagnold (1941)          u*t = 0.1 sqrt((s - 1) g d),    d >= 0.2 mm, NaN below
    Iversen & White (1982)  u*t = A sqrt(s g d),   A = A(Re) sqrt(1 + K / (rho_s g d^2.5)),   Re = u*t d / nu
    Shao & Lu (2000)        u*t^2 = 0.0123 (s g d + G / (rho d)),    G = 3e-4 kg s-2, 1.65e-4 to 5e-4

Impact threshold u_t, at which transport ceases: the numbers of Kok et al. (2012), figure 21a, for quartz in
air at sea level, logarithms joined by straight lines. Flux, above u_t:

    Kawamura (1951)      Q = 2.78 (rho / g) (u* - u_t) (u* + u_t)^2
    Owen (1964)          Q = (rho / g) u*^3 (1/4 + w / (3 u*)) (1 - u_t^2 / u*^2),    w the settling velocity
    Durán et al. (2011)  Q = 5 (rho / g) u_t (u*^2 - u_t^2)

Reference: Bagnold (1941), The Physics of Blown Sand; Iversen & White (1982), Sedimentology 29, 111, eqs (3.5)
and (3.12); Shao & Lu (2000), J. Geophys. Res. 105, 22437; Kok, Parteli, Michaels & Bou Karam (2012), Rep.
Prog. Phys. 75, 106901; its numbers and the two equations above it as in the public code of Martin & Kok
(2018), AeolianFieldworkAnalysis; Kawamura (1951), Rep. Inst. Sci. Technol. Univ. Tokyo 5, 95; Owen (1964), J.
Fluid Mech. 20, 225; Durán, Claudin & Andreotti (2011), Aeolian Res. 3, 243; 5 from Kok et al., eq. (2.34).
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, isnan, log, nan, sqrt

import numpy as np

QUARTZ, GRAVITY = 2650.0, 9.81  # kg m-3, m s-2
ROUNDS = 100  # of an iteration, which needs ten
SAME_DENSITY = 0.1  # logarithm of a ratio of densities within which the numbers of Kok et al. hold [1]
KOK = (  # impact threshold [mm s-1] by diameter [um]
    "50 191.4 57 158.7 65 139.5 80 139.0 100 141.3 125 149.0 150 156.1 200 178.0 250 198.1 325 226.8 "
    "400 253.4 500 285.7 650 326.6 800 364.3 1000 407.3 1150 436.0 1350 473.7 1650 521.3 2000 573.0"
)


@dataclass(frozen=True)
class Sand:
    """Grains of one size in air."""

    diameter: float  # m
    density: float = QUARTZ  # kg m-3
    air_density: float = 1.225  # kg m-3
    viscosity: float = 1.46e-5  # m2 s-1, kinematic, of the air

    @property
    def density_ratio(self) -> float:
        """Density of the grains over that of the air [1]."""
        return self.density / self.air_density


def iversen_white(sand: Sand) -> float:
    """Fluid threshold of Iversen & White [m s-1], with A of their three ranges of Re."""
    adhesion = 6e-7 / (sand.density * GRAVITY * sand.diameter**2.5)
    friction = scale = sqrt((1.0 + adhesion) * sand.density_ratio * GRAVITY * sand.diameter)
    for _ in range(ROUNDS):
        reynolds = friction * sand.diameter / sand.viscosity
        if reynolds > 10.0:
            friction = scale * 0.120 * (1.0 - 0.0858 * exp(-0.0617 * (reynolds - 10.0)))
        elif reynolds > 0.3:
            friction = scale * 0.129 / sqrt(1.928 * reynolds**0.092 - 1.0)
        else:
            friction = scale * 0.2 / sqrt(1.0 + 2.5 * reynolds)
    return friction


def shao_lu_threshold(sand: Sand, cohesion: float = 3e-4) -> float:
    """Fluid threshold of Shao & Lu [m s-1]; `cohesion` is G [kg s-2]."""
    pull = cohesion / (sand.air_density * sand.diameter)
    return sqrt(0.0123 * (sand.density_ratio * GRAVITY * sand.diameter + pull))


def kok_impact_threshold(sand: Sand) -> float:
    """Impact threshold of Kok et al. [m s-1]; NaN beyond 0.05 to 2 mm and for other grains or air."""
    diameters, values = np.array(KOK.split(), dtype=float).reshape(-1, 2).T
    if abs(log(sand.density_ratio / Sand(sand.diameter).density_ratio)) > SAME_DENSITY:
        return nan
    place, ends = log(1e6 * sand.diameter), {"left": nan, "right": nan}
    return 1e-3 * exp(np.interp(place, np.log(diameters), np.log(values), **ends))


def settling_speed_of_sphere(sand: Sand) -> float:
    """Speed at which a sphere falls in still air, by the drag of Schiller & Naumann [m s-1]."""
    speed = stokes = (sand.density_ratio - 1.0) * GRAVITY * sand.diameter**2 / (18.0 * sand.viscosity)
    for _ in range(ROUNDS):  # the mean of two steps converges at any size
        reynolds = speed * sand.diameter / sand.viscosity
        speed = 0.5 * (speed + stokes / (1.0 + 0.15 * reynolds**0.687))
    return speed


FLUID: dict[str, Callable[[Sand], float]] = {
    "Bagnold (1941)": lambda s: (
        sqrt(0.01 * (s.density_ratio - 1.0) * GRAVITY * s.diameter) if s.diameter >= 2e-4 else nan
    ),
    "Iversen & White (1982)": iversen_white,
    "Shao & Lu (2000)": shao_lu_threshold,
}
IMPACT: dict[str, Callable[[Sand], float]] = {"Kok et al. (2012)": kok_impact_threshold}
RANGES = {  # of laws that are NaN beyond, and what stands in
    "Bagnold (1941)": "holds from 0.2 mm on",
    "Kok et al. (2012)": "hold for quartz of 0.05 to 2 mm in air; fluxes take 0.8 of Iversen & White",
}
FLUX: dict[str, Callable[[Sand, float, float], float]] = {  # over rho / g, of sand, u* and u_t
    "Kawamura (1951)": lambda _, u, t: 2.78 * (u - t) * (u + t) ** 2,
    "Owen (1964)": lambda sand, u, t: u * (0.25 + settling_speed_of_sphere(sand) / (3.0 * u)) * (u**2 - t**2),
    "Durán et al. (2011)": lambda _, u, t: 5.0 * t * (u**2 - t**2),
}


def flux_by(name: str, sand: Sand, friction: float) -> float:
    """Flux by one formula [kg m-1 s-1]; without a number of Kok et al. u_t is 0.8 of Iversen & White's."""
    impact = kok_impact_threshold(sand)
    threshold = 0.8 * iversen_white(sand) if isnan(impact) else impact
    unit = sand.air_density / GRAVITY
    return unit * FLUX[name](sand, friction, threshold) if friction > threshold else 0.0
