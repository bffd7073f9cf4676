"""Di Felice: drag on a sphere among others.

    C_D = (0.63 + 4.8 / sqrt(Re'))^2 eps^(2 - chi),    Re' = eps Re
    chi = 3.7 - 0.65 exp(-(1.5 - log10 Re')^2 / 2)

Reference: Di Felice (1994), Int. J. Multiphase Flow 20, 153.
"""

from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.drag import SLIP_LEAST, sphere_rate


@ti.func
def voidage_function(reynolds, void):
    """eps^(2 - chi) [1], by which neighbours multiply the drag coefficient of a sphere alone at Re'."""
    distance = 1.5 - ti.log(reynolds) / ti.log(10.0)
    exponent = 3.7 - 0.65 * ti.exp(-0.5 * distance * distance)
    return void ** (2.0 - exponent)


@ti.func
def drag_rate(slip, radius, mass, density, viscosity, void):
    """Rate of drag on a sphere among others [s-1]."""
    reynolds = ti.max(void * slip, SLIP_LEAST) * 2.0 * radius / viscosity
    root = 0.63 + 4.8 / ti.sqrt(reynolds)
    alone = sphere_rate(root * root * ti.max(slip, SLIP_LEAST), radius, mass, density)
    return alone * voidage_function(reynolds, void)
