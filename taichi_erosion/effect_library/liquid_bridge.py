"""Liquid bridge: the pull of a water neck between two moist grains.

    F = f 2 pi R gamma cos(theta) / (1 + 1.05 S + 2.5 S^2),    S = s sqrt(R / V),    s >= 0
    F = 0 beyond s_max = (1 + theta / 2) V^(1/3)
    f = f_wet ((w - w_a) / w_1)^p,    at most 1,    w_1 = 0.01

    R   = 2 R_i R_j / (R_i + R_j), of a wall 2 R_i                   [m]
    V   = 2 (w - w_a) (rho_s / rho_w) (4/3) pi R_m^3 / N             water of one bridge [m3]
    R_m = (R_i + R_j) / 2, of a wall R_i                             [m]
    w_a = w_0 + 0.14 c^2 + 0.17 c                                   adsorbed water, c clay by mass [kg kg-1]

with gamma the surface tension [N m-1], theta the contact angle [rad], s the gap [m] (an overlap counts as
touch), w the gravimetric moisture [kg kg-1], w_a the part adsorbed in films (w_0) and on clay, which forms
no neck, rho_s and rho_w the densities of solid and water [kg m-3], N the bridges that share the water of a
grain. The short form is written for the whole gap s; in terms of half the gap its factors are 2.1 and 10. A
neck forms when grains touch and holds until it ruptures.

f is the share of the smooth-sphere force that rough grains keep: asperities hold the water in small menisci,
which merge as it becomes more (Halsey & Levine). Smooth spheres would need winds of tens of metres a second
at a moisture where sand is known to move, and a pull that does not grow with water: at touch their force
does not know the volume. p = 0.68 is the power of the measured rise of the threshold stress (Fecan et al.),
and f_wet = 0.004 lets a grain of 0.25 mm in the saddle of three others follow their 1.49 at 1 % of water.
Strength multiplies the force. Holds for necks of V < 0.05 R^3.

Reference: Willett, Adams, Johnson & Seville (2000), Langmuir 16, 9396, short form for equal spheres; Lian,
Thornton & Adams (1993), J. Colloid Interface Sci. 161, 138 (rupture); Halsey & Levine (1998), Phys. Rev.
Lett. 80, 3141 (roughness); Fecan, Marticorena & Bergametti (1999), Ann. Geophys. 17, 149 (adsorbed water).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, pi
from typing import Any

import numpy as np

from taichi_erosion.core.effect import Check, Checks, Conditions, Constants, Probe, effect_of, quantity
from taichi_erosion.core.ti import ti

WATER_DENSITY = 998.0  # at 20 C [kg m-3]
FALL_LINEAR = 1.05  # Willett et al. (2000), eq. (12) [1]
CLAY_LINEAR = 0.17  # Fecan et al. (1999), whose percentages are fractions here [1]
CLAY_SQUARE = 0.14  # likewise [1]
REFERENCE = 0.01  # free water at which the share is f_wet [kg kg-1]
FALL_SQUARE = 2.5  # Willett et al. (2000), eq. (12) [1]


@dataclass(frozen=True)
class Params:
    surface_tension: float = quantity(0.0728, "N m-1", "water against air, 20 C", low=1e-3, high=0.1)
    contact_angle: float = quantity(0.3, "rad", "water on the grain", low=0.0, high=1.5)
    bridges: float = quantity(6.0, "1", "bridges that share a grain's water", low=1.0, high=12.0)
    adsorbed: float = quantity(0.0, "kg kg-1", "moisture that forms no neck", low=0.0, high=0.2)
    wet_fraction: float = quantity(
        0.004, "1", "share of the smooth-sphere force at 1 % water", low=1e-4, high=1.0
    )
    exponent: float = quantity(0.68, "1", "of that share against free water", low=0.0, high=2.0)
    grain_density: float = quantity(2650.0, "kg m-3", "of the solid", low=500.0, high=8000.0)


def free_water(params: Params, conditions: Mapping[str, Any]) -> Any:
    """Moisture that forms necks [kg kg-1]: clay adsorbs the rest; Fecan et al. (1999), eq. (14)."""
    clay = np.asarray(conditions.get("clay_fraction", 0.0))
    in_films = params.adsorbed + CLAY_SQUARE * clay**2 + CLAY_LINEAR * clay
    return np.maximum(np.asarray(conditions.get("moisture", 0.0)) - in_films, 0.0)


def dose(params: Params, conditions: Mapping[str, Any]) -> Any:
    """Share of the smooth-sphere force over what it is at the reference [1]; none without free water."""
    free = free_water(params, conditions)
    grown = np.where(free > 0.0, (np.maximum(free, 1e-12) / REFERENCE) ** params.exponent, 0.0)
    return np.minimum(grown, 1.0 / params.wet_fraction)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica; without water in necks all of them vanish."""
    free = float(free_water(params, conditions))
    smooth = 2.0 * pi * params.surface_tension * cos(params.contact_angle)
    share = params.wet_fraction * float(dose(params, conditions))
    volume = 2.0 * free * params.grain_density / WATER_DENSITY * (4.0 / 3.0) * pi / params.bridges
    return {
        "pull": strength * share * smooth * conditions.get("adhesion_scale", 1.0),  # force over R [N m-1]
        "volume": volume,  # V / R_m^3 [1]
        "rupture": (1.0 + 0.5 * params.contact_angle) * volume ** (1.0 / 3.0),  # s_max / R_m [1]
    }


@ti.func
def pull(constants, pair):
    """Attraction [N]."""
    mean = 0.5 * (pair.radius_i + ti.select(pair.radius_j > 0.0, pair.radius_j, pair.radius_i))
    stretch = ti.max(pair.gap, 0.0)
    attraction = 0.0
    if pair.touched > 0.0 and stretch < constants.rupture * mean:
        radius = 2.0 * pair.radius_effective
        reduced = stretch * ti.sqrt(radius / (constants.volume * mean * mean * mean))
        attraction = constants.pull * radius / (1.0 + reduced * (FALL_LINEAR + FALL_SQUARE * reduced))
    return attraction


def reach(constants: Constants, radius: float) -> float:
    """Longest rupture gap [m]."""
    return constants["rupture"] * radius


def can_act(conditions: Mapping[str, Any]) -> Any:
    """Dry grains have no bridges, nor have those whose clay holds all water."""
    return free_water(Params(), conditions) > 0.0


def checks(probe: Probe) -> Checks:
    radius, tension, angle = 1e-4, 0.07, pi / 3.0
    rough = {"wet_fraction": 0.02, "exponent": 0.5}
    water = Params(tension, angle, bridges=4.0, adsorbed=0.005, grain_density=2000.0, **rough)
    touching = 0.02 * 2.0 * pi * radius * tension * 0.5  # cos 60 deg = 1/2
    volume = 2.0 * 0.01 * (2000.0 / 998.0) * 4.18879020 * radius**3 / 4.0
    rupture = (1.0 + pi / 6.0) * volume ** (1.0 / 3.0)
    unit = (volume / radius) ** 0.5  # gap where S = 1

    def force(gap: float, radius_j: float = radius, touched: float = 1.0, **conditions: float) -> float:
        effective = radius if radius_j == 0.0 else radius * radius_j / (radius + radius_j)
        members = {"gap": gap, "radius_i": radius, "radius_j": radius_j, "touched": touched}
        return probe(water, {"moisture": 0.015} | conditions, radius_effective=effective, **members)

    yield Check("touching equal grains pull with f 2 pi R gamma cos(theta)", force(0.0), touching)
    yield Check("four times the free water pulls twice as hard", force(0.0, moisture=0.045), 2.0 * touching)
    yield Check("overlap does not change the pull", force(-1e-7), touching)
    yield Check("at S = 1/10 it has fallen by 1 + 0.105 + 0.025", force(0.1 * unit), touching / 1.13)
    half = touching / (1.0 + 1.05 * 0.999 * rupture / unit + 2.5 * (0.999 * rupture / unit) ** 2)
    yield Check("a neck holds until just before its rupture gap", force(0.999 * rupture), half)
    yield Check("a ruptured neck pulls no more", force(1.001 * rupture), 0.0)
    yield Check("grains that never met have no neck", force(0.1 * unit, touched=0.0), 0.0)
    yield Check("adsorbed water forms no neck", force(0.0, moisture=0.005), 0.0)
    # 10 % clay holds 0.0184 kg/kg more, as if it were drier by that
    clayey = force(0.1 * unit, moisture=0.0334, clay_fraction=0.1)
    yield Check("clay holds its share of the water", clayey, touching / 1.13)
    yield Check("a wall pulls twice as hard as an equal grain", force(0.0, radius_j=0.0), 2.0 * touching)


EFFECT = effect_of(
    __name__,
    "capillary bridges between moist grains",
    "pair",
    pull,
    after_touch=True,
    reads=("moisture", "clay_fraction"),
    uncertain={"exponent": 0.5},  # measured rises of thresholds and heaps lie between a third and linear
    expected={"repose_angle": 1, "threshold_u_star": 1, "flux": -1},
)
