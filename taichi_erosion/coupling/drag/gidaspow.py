"""Gidaspow: Ergun's equation in a dense bed, the standard drag curve of a swarm above it.

    eps >= 0.8:  schiller_naumann at Re' = eps Re, times eps^-2.65
    eps < 0.8:   b = V / (m (1 - eps)) (150 (1 - eps)^2 mu / (eps d^2) + 1.75 (1 - eps) rho s / d)

with V the volume of the sphere [m3] and mu = rho nu [Pa s].

Reference: Gidaspow (1994), Multiphase Flow and Fluidization, ch. 2; Ergun (1952), Chem. Eng. Prog. 48, 89.
"""

from math import pi

from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.drag import sphere_rate
from taichi_erosion.coupling.drag.schiller_naumann import coefficient_times_slip

DENSE = 0.8  # void fraction below which Ergun's equation holds [1]
VOID_LEAST = 0.2  # below any packing of spheres: keeps Ergun's term finite in cells that grains overfill [1]


@ti.func
def drag_rate(slip, radius, mass, density, viscosity, void):
    """Rate of drag on a sphere in a bed or above it [s-1]."""
    diameter = 2.0 * radius
    share = ti.max(void, VOID_LEAST)
    dilute = sphere_rate(coefficient_times_slip(share * slip, diameter, viscosity), radius, mass, density)
    rate = dilute * share**-2.65
    if share < DENSE:
        solid = 1.0 - share
        viscous = 150.0 * solid * viscosity / (share * diameter * diameter)
        volume = pi / 6.0 * diameter * diameter * diameter
        rate = volume * density * (viscous + 1.75 * slip / diameter) / mass
    return rate
