"""Shear lift: the force across the stream on a grain in a sheared wind, free or on the bed.

    free    F = 1.615 d^2 sqrt(rho mu |G|) f (-s_z, 0, s_x) G/|G|
            f = (1 - c) exp(-Re / 10) + c,     Re <= 40
            f = 0.0524 sqrt(a Re),             Re > 40
            c = 0.3314 sqrt(a),   a = |G| d / (2 |s|),   Re = rho |s| d / mu
    on bed  F_z = (pi/8) rho d^2 s_x |s_x| C,  C = 3.663 / (Re_x^2 + 0.1173)^0.22,  Re_x = rho |s_x| d / mu

with s = u - v the velocity of the air relative to the grain [m s-1], G = du/dz [s-1], d the diameter [m],
rho and mu density [kg m-3] and viscosity [Pa s] of the air. A grain whose centre is a radius or less above
the bed has the lift of a sphere at rest on a wall, whose lift at small Re is that of Leighton and
Acrivos, 0.576 rho G^2 d^4; it fades to the law of the free grain over a height of n diameters. Grains
inside the bed are lifted little because the air between them hardly moves. Strength multiplies the force.
Holds for Re < 100 and a < 0.4 (free), Re < 250 (on the bed).

Reference: Saffman (1965), J. Fluid Mech. 22, 385; Mei (1992), Int. J. Multiphase Flow 18, 145, fit of Dandy
& Dwyer; Zeng, Najjar, Balachandar & Fischer (2009), Phys. Fluids 21, 033302 (on a wall); Leighton & Acrivos
(1985), Z. Angew. Math. Phys. 36, 174.
"""

from dataclasses import dataclass
from math import exp, pi

from taichi_erosion.core.effect import Check, Checks, Conditions, Constants, Probe, effect_of, quantity
from taichi_erosion.core.ti import ti

SLOWEST = 1e-9  # slip below which there is no lift [m s-1]


@dataclass(frozen=True)
class Params:
    coefficient: float = quantity(1.615, "1", "of Saffman's lift of a free grain", low=0.0, high=6.46)
    wall_coefficient: float = quantity(3.663, "1", "of the lift on the bed, Zeng et al.", low=0.0, high=10.0)
    wall_range: float = quantity(1.0, "1", "height over d in which the bed fades", low=0.1, high=10.0)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    free, wall = strength * params.coefficient, strength * params.wall_coefficient
    return {"free": free, "wall": wall, "range": params.wall_range}


@ti.func
def free_lift(grain: ti.template(), slip, diameter):
    """Lift over Saffman's coefficient of a grain far from walls [N]."""
    speed = ti.max(slip.norm(), SLOWEST)
    shear = ti.abs(grain.air_shear)
    reynolds = grain.air_density * speed * diameter / grain.air_viscosity
    ratio = 0.5 * shear * diameter / speed
    curb = 0.3314 * ti.sqrt(ratio)
    reduction = (1.0 - curb) * ti.exp(-0.1 * reynolds) + curb
    if reynolds > 40.0:
        reduction = 0.0524 * ti.sqrt(ratio * reynolds)
    size = diameter * diameter * ti.sqrt(grain.air_density * grain.air_viscosity * shear) * reduction
    across = 0.0 * slip
    across[0] = -slip[2]
    across[2] = slip[0]
    return ti.select(grain.air_shear >= 0.0, size, -size) * across


@ti.func
def wall_lift(grain: ti.template(), slip, diameter):
    """Lift over its coefficient of a grain that lies on the bed [N], upwards."""
    reynolds = grain.air_density * slip[0] * diameter / grain.air_viscosity
    area = 0.125 * pi * grain.air_density * diameter * diameter
    return area * slip[0] * ti.abs(slip[0]) / (reynolds * reynolds + 0.1173) ** 0.22


@ti.func
def push(constants, grain):
    """Force [N] and torque [N m]."""
    diameter = 2.0 * grain.radius
    slip = grain.air_velocity - grain.velocity
    force = 0.0 * slip
    if grain.air_viscosity > 0.0:
        risen = (grain.height - grain.radius) / (constants.range * diameter)
        near = 1.0 - ti.min(ti.max(risen, 0.0), 1.0)
        force = (1.0 - near) * constants.free * free_lift(grain, slip, diameter)
        force[2] += near * constants.wall * wall_lift(grain, slip, diameter)
    return force, 0.0 * force


def checks(probe: Probe) -> Checks:
    air = {"air_density": 1.2, "air_viscosity": 1.8e-5, "radius": 1e-4}
    lifted = Params(coefficient=1.7, wall_coefficient=3.5, wall_range=2.0)

    def lift(speed: float, shear: float, height: float) -> float:
        members = {"air_velocity": (speed, 0.0, 0.0), "air_shear": shear, "height": height}
        return probe(lifted, {}, **air, **members)[0][2]

    # free: Re = 1.2 0.3 2e-4 / 1.8e-5 = 4, a = 300 1e-4 / 0.3 = 0.1
    curb = 0.3314 * 0.1**0.5
    free = 1.7 * 4e-8 * (1.2 * 1.8e-5 * 300.0) ** 0.5 * ((1.0 - curb) * exp(-0.4) + curb) * 0.3
    fast = 1.7 * 4e-8 * (1.2 * 1.8e-5 * 3e4) ** 0.5 * 0.0524 * (0.5 * 80.0) ** 0.5 * 6.0
    wall = pi / 8.0 * 1.2 * 4e-8 * 0.09 * 3.5 / 16.1173**0.22
    still = 0.576 * 1.2 * 100.0**2 * (2e-4) ** 4 * 3.5 / 3.663
    yield Check("a free grain is lifted after Saffman and Mei", lift(0.3, 300.0, 0.1), free)
    yield Check("beyond Re = 40 the lift grows as sqrt(Re)", lift(6.0, 3e4, 0.1), fast)
    yield Check("a shear that falls upwards presses down", lift(0.3, -300.0, 0.1), -free)
    yield Check("on the bed the wall's law holds", lift(0.3, 300.0, 1e-4), wall)
    yield Check("half way it is the mean of both", lift(0.3, 300.0, 3e-4), 0.5 * (free + wall))
    yield Check("creeping flow: 0.576 rho G^2 d^4", lift(0.01, 100.0, 1e-4), still, rtol=0.05)


EFFECT = effect_of(
    __name__,
    "shear lift, free (Saffman) and on the bed",
    "grain",
    push,
    through_air=True,
    expected={"threshold_u_star": -1, "flux": 1},
)
