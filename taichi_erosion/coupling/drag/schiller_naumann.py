"""Schiller & Naumann: the standard drag curve of a sphere alone.

    C_D = 24 / Re (1 + 0.15 Re^0.687), never below 0.44

Reference: Schiller & Naumann (1935), Z. VDI 77, 318.
"""

from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.drag import SLIP_LEAST, sphere_rate

NEWTON = 0.44  # drag coefficient of a sphere at high Reynolds number [1]


@ti.func
def coefficient_times_slip(slip, diameter, viscosity):
    """C_D s of the standard drag curve [m s-1]."""
    reynolds = ti.max(slip, SLIP_LEAST) * diameter / viscosity
    curved = 24.0 * viscosity / diameter * (1.0 + 0.15 * reynolds**0.687)
    return ti.max(curved, NEWTON * slip)


@ti.func
def drag_rate(slip, radius, mass, density, viscosity, void):
    """Rate of drag on a sphere alone [s-1]."""
    return sphere_rate(coefficient_times_slip(slip, 2.0 * radius, viscosity), radius, mass, density)
