"""Drag laws: the rate b at which drag pulls a sphere towards the velocity of the air, dv/dt = b (u - v).

    b = (pi / 8) rho d^2 C_D s / m,    Re = s d / nu

with s = |u - v| the slip speed [m s-1], d the diameter [m], m the mass [kg], rho and nu density [kg m-3]
and kinematic viscosity [m2 s-1] of the air, eps the share of the volume that is air [1]. For grains in a bed,
u is the velocity between the grains and the pressure force on the grain counts by itself (model A).

    schiller_naumann  C_D = 24 / Re (1 + 0.15 Re^0.687), never below 0.44
    two_limits        C_D = (sqrt(0.5) + sqrt(24 / Re))^2
    di_felice         C_D = (0.63 + 4.8 / sqrt(Re'))^2 eps^(2 - chi), Re' = eps Re,
                      chi = 3.7 - 0.65 exp(-(1.5 - log10 Re')^2 / 2)
    gidaspow          eps >= 0.8: schiller_naumann at Re' times eps^-2.65;
                      eps < 0.8:  Ergun, b = V / (m (1 - eps)) (150 (1 - eps)^2 mu / (eps d^2)
                                                               + 1.75 (1 - eps) rho s / d)

Reference: Schiller & Naumann (1935), Z. VDI 77, 318; Ferguson & Church (2004), J. Sediment. Res. 74, 933 (two
limits); Di Felice (1994), Int. J. Multiphase Flow 20, 153; Zhou et al. (2010), J. Fluid Mech. 661, 482
(model A); Gidaspow (1994), Multiphase Flow and Fluidization, ch. 2; Ergun (1952), Chem. Eng. Prog. 48, 89.
"""

from math import pi
from typing import Any

from taichi_erosion.core.ti import ti

NEWTON = 0.44  # drag coefficient of a sphere at high Reynolds number [1]
ROUGH_NEWTON = 0.5  # the same for natural grains in the law with two limits [1]
DENSE = 0.8  # void fraction below which Ergun's equation holds [1]
VOID_LEAST = 0.2  # below any packing of spheres: keeps Ergun's term finite in cells that grains overfill [1]
SLIP_LEAST = 1e-9  # keeps logarithms and divisions finite where air and grain move together [m s-1]


@ti.func
def sphere_rate(coefficient_times_slip, radius, mass, density):
    """Rate of drag [s-1] from C_D s [m s-1]."""
    return 0.5 * pi * density * radius * radius * coefficient_times_slip / mass


@ti.func
def standard_drag(slip, diameter, viscosity):
    """C_D s of the standard drag curve [m s-1]."""
    reynolds = ti.max(slip, SLIP_LEAST) * diameter / viscosity
    curved = 24.0 * viscosity / diameter * (1.0 + 0.15 * reynolds**0.687)
    return ti.max(curved, NEWTON * slip)


@ti.func
def schiller_naumann(slip, radius, mass, density, viscosity, void):
    """Rate of drag on a sphere alone [s-1]."""
    return sphere_rate(standard_drag(slip, 2.0 * radius, viscosity), radius, mass, density)


@ti.func
def two_limits(slip, radius, mass, density, viscosity, void):
    """Rate of drag on a grain alone, between Stokes' and Newton's limits [s-1]."""
    root = ti.sqrt(ROUGH_NEWTON * slip) + ti.sqrt(12.0 * viscosity / radius)
    return sphere_rate(root * root, radius, mass, density)


@ti.func
def di_felice(slip, radius, mass, density, viscosity, void):
    """Rate of drag on a sphere among others [s-1]."""
    reynolds = ti.max(void * slip, SLIP_LEAST) * 2.0 * radius / viscosity
    root = 0.63 + 4.8 / ti.sqrt(reynolds)
    distance = 1.5 - ti.log(reynolds) / ti.log(10.0)
    exponent = 3.7 - 0.65 * ti.exp(-0.5 * distance * distance)
    alone = sphere_rate(root * root * ti.max(slip, SLIP_LEAST), radius, mass, density)
    return alone * void ** (2.0 - exponent)


@ti.func
def gidaspow(slip, radius, mass, density, viscosity, void):
    """Rate of drag on a sphere in a bed or above it [s-1]."""
    diameter = 2.0 * radius
    share = ti.max(void, VOID_LEAST)
    dilute = sphere_rate(standard_drag(share * slip, diameter, viscosity), radius, mass, density)
    rate = dilute * share**-2.65
    if share < DENSE:
        solid = 1.0 - share
        viscous = 150.0 * solid * viscosity / (share * diameter * diameter)
        volume = pi / 6.0 * diameter * diameter * diameter
        rate = volume * density * (viscous + 1.75 * slip / diameter) / mass
    return rate


DRAG: dict[str, Any] = {
    "schiller_naumann": schiller_naumann,
    "two_limits": two_limits,
    "di_felice": di_felice,
    "gidaspow": gidaspow,
}
