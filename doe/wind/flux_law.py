"""Law of the flux of saturated transport: linear in the stress, or with the cube of the wind.

    Q = a (u*^2 - u_t^2) (u* + u_t)^m

with u* the friction velocity of the wind, u_t that of the impact threshold [m s-1]. m = 0 is linear in the
stress: grains fly as fast in any wind, which carries more of them. m = 1 is the law of Kawamura, whose
grains fly faster in stronger winds; it tends to u*^3. Holds for winds above the threshold.

m is the slope of a straight line in logarithms, whose standard error counts the scatter about the line and
the error of u_t. With a given m' the law has one number less, and F = ((m - m') / error)^2 has 1 and n - 2
degrees of freedom; its p says how often flux that obeys the law with m' lies as far off it.

Reference: Kawamura (1951), Rep. Inst. Sci. Technol. Univ. Tokyo 5, 95 (m = 1); Creyssels et al. (2009), J.
Fluid Mech. 625, 47 (m = 0); Draper & Smith (1998), Applied Regression Analysis, 3rd ed., ch. 6 (F-test).
"""

from dataclasses import dataclass
from math import hypot

import numpy as np
import scipy

from taichi_erosion.core.setup import Floats
from taichi_erosion.measures.threshold import Bracket, friction_velocity_at_zero_flux

LINEAR, CUBIC = 0.0, 1.0  # m of both laws [1]
LEAST_WINDS = 4  # two more than a line needs


@dataclass(frozen=True)
class FluxPower:
    """The exponent m with its standard error [1], and the degrees of freedom of the latter."""

    value: float
    error: float
    freedom: int

    def chance(self, law: float) -> float:
        """Chance of so large a difference where the law with this m holds [1]."""
        return float(scipy.special.fdtrc(1, self.freedom, ((self.value - law) / self.error) ** 2))


def flux_power(winds: Floats, flux: Floats, threshold: Bracket) -> FluxPower | None:
    """Exponent m from friction velocities [m s-1] and fluxes; None where fewer than four winds carry grains.

    `threshold` is u_t with its standard error on either side.
    """
    carried = np.isfinite(flux) & (flux > 0.0) & (winds > threshold.high)
    if np.count_nonzero(carried) < LEAST_WINDS:
        return None
    wind, logs = winds[carried], np.log(flux[carried])

    def line(end: float) -> tuple[float, float]:
        """Slope and its error at one threshold [m s-1]."""
        excess = logs - np.log(wind**2 - end**2)
        found = scipy.stats.linregress(np.log(wind + end), excess)
        return float(found.slope), float(found.stderr)

    slope, scatter = line(threshold.middle)
    open_end = 0.5 * abs(line(threshold.high)[0] - line(threshold.low)[0])
    return FluxPower(slope, hypot(scatter, open_end), int(np.count_nonzero(carried)) - 2)


def vanishing_wind(left: Floats, borne: Floats, measure: Floats, density: float) -> Bracket | None:
    """Friction velocity at which a measure of saturated transport in steady winds would vanish.

    `left` and `borne` are the stresses of air and grains at the bed [Pa], wind by wind, `density` that of the
    air [kg m-3]. Both stresses together count, not that of the lid: the air above stores momentum. Fitted,
    and None, as by `friction_velocity_at_zero_flux`.
    """
    return friction_velocity_at_zero_flux(list(zip(np.sqrt((left + borne) / density), measure, strict=True)))
