"""Two limits, hindered: the law of `two_limits` for a grain that has others beside it.

    C_D = (sqrt(0.5) + sqrt(24 / Re'))^2 eps^(2 - chi),    Re' = eps Re
    chi = 3.7 - 0.65 exp(-(1.5 - log10 Re')^2 / 2)

Di Felice's voidage function times the drag on a grain alone. In air without other grains (eps = 1) it is
`two_limits`. Inside a bed it is several times as large, as the pressure drop of packed beds is, so that wind
reaches less deep: over layers of touching spheres in creeping shear the column begins 0.17 (quadratic) and
0.12 diameters (triangular) below their tops, where that of `two_limits` begins at 0.54 and resolved flow at
0.10 and 0.08 (`doe/bed_wind/`).

Reference: Di Felice (1994), Int. J. Multiphase Flow 20, 153 (voidage function); Duran, Andreotti & Claudin
(2012), Phys. Fluids 24, 103306 (0.5 and 24).
"""

from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.drag import SLIP_LEAST
from taichi_erosion.coupling.drag.di_felice import voidage_function
from taichi_erosion.coupling.drag.two_limits import drag_rate as rate_alone


@ti.func
def drag_rate(slip, radius, mass, density, viscosity, void):
    """Rate of drag on a grain among others [s-1]."""
    superficial = ti.max(void * slip, SLIP_LEAST)
    reynolds = superficial * 2.0 * radius / viscosity
    alone = rate_alone(superficial, radius, mass, density, viscosity, 1.0)
    return alone * voidage_function(reynolds, void) / void
