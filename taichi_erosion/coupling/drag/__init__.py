"""Drag laws, one per file: the rate b at which a sphere relaxes to the velocity of the air.

    dv/dt = b (u - v)
    b = (pi / 8) rho d^2 C_D s / m,    Re = s d / nu

with s = |u - v| the slip speed [m s-1], d the diameter [m], m the mass [kg], rho and nu density [kg m-3]
and kinematic viscosity [m2 s-1] of the air, eps the share of the volume that is air [1]. For grains in a bed,
u is the velocity between the grains and the pressure force on the grain counts by itself (model A).

Every law is a ti.func drag_rate(slip, radius, mass, density, viscosity, void) -> b [s-1]. A new one stands in
a file of its name, and in `DragLaw` of `core/setup.py`, by which scenes accept it.

Reference: Zhou et al. (2010), J. Fluid Mech. 661, 482 (model A).
"""

from importlib import import_module
from math import pi
from typing import Any

from taichi_erosion.core.ti import ti

SLIP_LEAST = 1e-9  # keeps logarithms and divisions finite where air and grain move together [m s-1]


def drag_law(name: str) -> Any:
    """Device function of the law with this name."""
    return import_module(f"{__name__}.{name}").drag_rate


@ti.func
def sphere_rate(coefficient_times_slip, radius, mass, density):
    """Rate of drag [s-1] from C_D s [m s-1]."""
    return 0.5 * pi * density * radius * radius * coefficient_times_slip / mass
