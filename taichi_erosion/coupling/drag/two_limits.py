"""Two limits: drag on a natural grain alone, between Stokes' and Newton's.

    C_D = (sqrt(0.5) + sqrt(24 / Re))^2

Reference: Duran, Andreotti & Claudin (2012), Phys. Fluids 24, 103306 (C_D = 0.5 and Re_c = 24 of sand in
air); the form is that of Ferguson & Church (2004), J. Sediment. Res. 74, 933.
"""

from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.drag import sphere_rate

ROUGH_NEWTON = 0.5  # drag coefficient of natural grains at high Reynolds number [1]


@ti.func
def drag_rate(slip, radius, mass, density, viscosity, void):
    """Rate of drag on a grain alone [s-1]."""
    root = ti.sqrt(ROUGH_NEWTON * slip) + ti.sqrt(12.0 * viscosity / radius)
    return sphere_rate(root * root, radius, mass, density)
