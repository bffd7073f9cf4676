"""Correlations for flowing grains: discharge through an opening and the angle of a discharged heap.

Reference: Beverloo, Leniger & van de Velde (1961), Chem. Eng. Sci. 15, 260; Zhou, Xu, Yu & Zulli (2002),
Powder Technology 125, 45.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

HOLE_EXPONENT, SLOT_EXPONENT = 2.5, 1.5  # round hole, slot without ends [1]
BEVERLOO_EDGES = np.linspace(1.2, 1.6, 41)  # k of spheres [1]
BEVERLOO_EDGE = 1.4  # k: grain diameters that the rim takes from the orifice [1], spheres


def discharge_exponent(orifice: Floats, diameter: float, flow: Floats, edge: float) -> tuple[float, float]:
    """N of W = c (D - k d)^n by least squares in the logarithms with k given, and the sum of squares left."""
    width = np.log(orifice - edge * diameter)
    line, (residual, *_) = np.polynomial.polynomial.polyfit(width, np.log(flow), 1, full=True)
    return float(line[1]), float(np.sum(residual))


def discharge_fit(orifice: Floats, diameter: float, flow: Floats) -> tuple[float, float]:
    """K and n of W = c (D - k d)^n, k searched in BEVERLOO_EDGES."""
    fits = [(discharge_exponent(orifice, diameter, flow, edge), edge) for edge in BEVERLOO_EDGES]
    (exponent, _), edge = min(fits, key=lambda fit: fit[0][1])
    return float(edge), exponent


def discharge_edge(orifice: Floats, diameter: float, flow: Floats, exponent: float) -> float:
    """K of W = c (D - k d)^n with n given: W^(1/n) is a straight line in D that crosses zero at k d."""
    slope, offset = np.polyfit(orifice, flow ** (1.0 / exponent), 1)
    return float(-offset / slope / diameter)


def discharge_coefficient(
    flow: Floats, bulk_density: Floats, orifice: Floats, diameter: float, exponent: float
) -> Floats:
    """C of W = C rho_b sqrt(g) (D - k d)^n [1], W for a slot that per length; k = 1.4."""
    open_width = orifice - BEVERLOO_EDGE * diameter
    return flow / (bulk_density * np.sqrt(9.81) * open_width**exponent)


def zhou_angle(
    friction: float, friction_wall: float, rolling: float, rolling_wall: float, diameter: float
) -> float:
    """Angle of repose of a heap of mono-sized spheres left on a plate [deg].

    68.61 mu_pp^0.27 mu_pw^0.22 l_pp^0.06 l_pw^0.12 d^-0.2 with the rolling frictions l as lengths in mm
    (the rolling torque is l F_n) and d in mm; here both lengths and the diameter are given in m. Found for
    glass of 2 to 10 mm.
    """
    frictions = friction**0.27 * friction_wall**0.22
    lengths = (1e3 * rolling) ** 0.06 * (1e3 * rolling_wall) ** 0.12
    return 68.61 * frictions * lengths * (1e3 * diameter) ** -0.2
