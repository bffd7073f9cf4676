"""Drag on spheres, pressure of air that rises through a bed, discharge of grains and their heap, in NumPy.

Reference: Schiller & Naumann (1935), Z. VDI 77, 318; Di Felice (1994), Int. J. Multiphase Flow 20, 153;
Ferguson & Church (2004), J. Sediment. Res. 74, 933; Gidaspow (1994), Multiphase Flow and Fluidization, ch. 2;
Ergun (1952), Chem. Eng. Prog. 48, 89; Beverloo, Leniger & van de Velde (1961), Chem. Eng. Sci. 15, 260; Zhou,
Xu, Yu & Zulli (2002), Powder Technology 125, 45.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.optimize import curve_fit, root_scalar
from scipy.special import fdtrc

from taichi_erosion.core.setup import Floats


@dataclass(frozen=True)
class Stream:
    """A sphere in air that moves past it."""

    slip: float  # m s-1
    diameter: float  # m
    density: float  # kg m-3, of the air
    viscosity: float  # Pa s
    void: float = 1.0  # share of the volume that is air [1]

    @property
    def reynolds(self) -> float:
        """Re = rho s d / mu [1]."""
        return self.density * self.slip * self.diameter / self.viscosity


def standard_coefficient(reynolds: float) -> float:
    """C_D = 24 / Re (1 + 0.15 Re^0.687), never below 0.44 [1]."""
    return max(24.0 / reynolds * (1.0 + 0.15 * reynolds**0.687), 0.44)


def force(stream: Stream, coefficient: float) -> float:
    """F = (pi / 8) C_D rho d^2 s^2 [N]."""
    return np.pi / 8.0 * coefficient * stream.density * (stream.diameter * stream.slip) ** 2


def schiller_naumann(stream: Stream) -> float:
    """Drag on a sphere alone [N]."""
    return force(stream, standard_coefficient(stream.reynolds))


def two_limits(stream: Stream) -> float:
    """Drag on a grain alone [N]: C_D = (sqrt(0.5) + sqrt(24 / Re))^2."""
    return force(stream, (np.sqrt(0.5) + np.sqrt(24.0 / stream.reynolds)) ** 2)


def among_others(stream: Stream, coefficient: float) -> float:
    """Di Felice's drag on a sphere among others [N], from the superficial slip eps s and its C_D alone."""
    chi = 3.7 - 0.65 * np.exp(-((1.5 - np.log10(stream.void * stream.reynolds)) ** 2) / 2.0)
    return force(stream, coefficient) * stream.void**2 * stream.void**-chi


def di_felice(stream: Stream) -> float:
    """Drag on a sphere among others [N]: C_D = (0.63 + 4.8 / sqrt(Re))^2 alone."""
    return among_others(stream, (0.63 + 4.8 / np.sqrt(stream.void * stream.reynolds)) ** 2)


def two_limits_hindered(stream: Stream) -> float:
    """Drag on a grain among others [N]: that of `two_limits` alone."""
    return among_others(stream, (np.sqrt(0.5) + np.sqrt(24.0 / (stream.void * stream.reynolds))) ** 2)


def gidaspow(stream: Stream) -> float:
    """Drag on one of the spheres that fill 1 - eps of the volume [N]."""
    volume = np.pi / 6.0 * stream.diameter**3
    if stream.void < 0.8:
        rise = pressure_gradient(stream.void, stream.void * stream.slip, stream)
        return rise * stream.void * volume / (1.0 - stream.void)
    coefficient = standard_coefficient(stream.void * stream.reynolds)
    over_solid = 0.75 * coefficient * stream.density * stream.slip / stream.diameter
    return over_solid * stream.void * stream.void**-2.65 * stream.slip * volume


LAWS: dict[str, Callable[[Stream], float]] = {
    "schiller_naumann": schiller_naumann,
    "two_limits": two_limits,
    "two_limits_hindered": two_limits_hindered,
    "di_felice": di_felice,
    "gidaspow": gidaspow,
}


def pressure_gradient(void: float, superficial: float, stream: Stream) -> float:
    """Ergun's pressure drop over length [Pa m-1] at a superficial velocity U [m s-1].

    dp/L = 150 (1 - eps)^2 mu U / (eps^3 d^2) + 1.75 (1 - eps) rho U^2 / (eps^3 d)
    """
    solid, diameter = 1.0 - void, stream.diameter
    viscous = 150.0 * solid**2 * stream.viscosity * superficial / diameter**2
    return (viscous + 1.75 * solid * stream.density * superficial**2 / diameter) / void**3


def terminal_velocity(diameter: float, solid: float, air: Stream, gravity: float = 9.81) -> float:
    """Speed [m s-1] at which Schiller-Naumann drag carries weight less buoyancy of a sphere."""
    weight = np.pi / 6.0 * diameter**3 * (solid - air.density) * gravity

    def excess(speed: float) -> float:
        return schiller_naumann(Stream(speed, diameter, air.density, air.viscosity)) - weight

    return root_scalar(excess, bracket=(1e-9, 1e3), xtol=1e-14).root


HOLE_EXPONENT, SLOT_EXPONENT = 2.5, 1.5  # round hole, slot without ends [1]
BEVERLOO_EDGE = 1.4  # k: grain diameters that the rim takes from the orifice [1], spheres


def discharge_exponent(orifice: Floats, diameter: float, flow: Floats, edge: float) -> tuple[float, float]:
    """N of W = c (D - k d)^n and its standard error: a straight line in the logarithms, with k given."""
    line = scipy.stats.linregress(np.log(orifice - edge * diameter), np.log(flow))
    return float(line.slope), float(line.stderr)


def discharge_edge(
    orifice: Floats, diameter: float, flow: Floats, exponent: float
) -> tuple[float, float, float]:
    """K of W = c (D - k d)^n with n given, its standard error, and the chance of the lack of fit.

    ln W is fitted, as flows scatter in proportion. Orifices hold several flows each; the F-test compares the
    scatter of their means about the law with that within orifices.
    """

    def law(width: Floats, log_factor: float, edge: float) -> Floats:
        return log_factor + exponent * np.log(width - edge * diameter)

    logs, most = np.log(flow), 0.99 * orifice.min() / diameter
    start = (float(np.mean(logs - exponent * np.log(orifice))), 1.0)
    found, covariance = curve_fit(law, orifice, logs, start, bounds=([-np.inf, -most], [np.inf, most]))
    groups = [logs[orifice == width] for width in np.unique(orifice)]
    within = sum(float(((group - group.mean()) ** 2).sum()) for group in groups)
    about = float(((logs - law(orifice, *found)) ** 2).sum()) - within
    freedom = len(groups) - 2, len(logs) - len(groups)
    ratio = (about / freedom[0]) / (within / freedom[1])
    return float(found[1]), float(np.sqrt(covariance[1, 1])), float(fdtrc(*freedom, max(ratio, 0.0)))


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
