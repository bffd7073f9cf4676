"""Two limits: drag on a grain alone, between Stokes' and Newton's.

    C_D = (sqrt(0.5) + sqrt(24 / Re))^2

Above that of a smooth sphere (Schiller & Naumann) by 14 % at Re = 1, 23 % at 10 and 31 % at 100.

Reference: Dallavalle (1948), Micromeritics, 2nd ed. (form); Duran, Andreotti & Claudin (2012), Phys.
Fluids 24, 103306 (0.5 and 24).
"""

from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.drag import sphere_rate

NEWTON = 0.5  # drag coefficient at high Reynolds number [1]


@ti.func
def drag_rate(slip, radius, mass, density, viscosity, void):
    """Rate of drag on a grain alone [s-1]."""
    root = ti.sqrt(NEWTON * slip) + ti.sqrt(12.0 * viscosity / radius)
    return sphere_rate(root * root, radius, mass, density)
