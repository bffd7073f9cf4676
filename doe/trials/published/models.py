"""Closed forms of the series of this folder: models of the study contract, without scatter of their own.

    threshold_u_star, flux            those of `evidence/models/reduced.py`
    fluid_threshold_u_star            u*t of the same model                                         [m s-1]
    impact_threshold_u_star           r u*t, r the ratio of both thresholds                         [m s-1]
    layer_height                      h, the same in every wind and over every sand                 [m]
    threshold_wind_speed              U, the same whatever the share of time with transport         [m s-1]
    flux_density_share                (S(a) - S(b)) / (b - a), S(z) = exp(-z / h), trap from a to b [m-1]

The effects of `reduced.py` act on thresholds and flux; those of the others stand below. A condition that a
source does not state is the one at which an effect changes nothing.
"""

from collections.abc import Callable
from math import pi

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import Conditions, Floats, Integers, Numbers, row_count
from taichi_erosion.evidence.models import reduced

USUAL_WIND = 0.4  # m s-1, friction velocity at which a growth with the wind changes nothing
USUAL_SAND = 4e-4  # m, diameter at which a growth with the grains changes nothing
THRESHOLD_RATIO = 0.82  # impact over fluid threshold [1]; Kok et al. (2012), Rep. Prog. Phys. 75, 106901
ANEMOMETER = 0.64  # m, height of the wind in the series of single minutes
OCEANO_DIAMETER = 3.98e-4  # m, median of its surface
CREEP_HEIGHT, CREEP_SHARE = (
    0.01,
    0.2,
)  # m, and of the flux at strength 1: grains that hop low (plausible size)
REDUCED = {"fluid_threshold_u_star": 1.0, "impact_threshold_u_star": THRESHOLD_RATIO}
Rule = Callable[[Conditions, Numbers, Numbers, int], Floats]  # conditions, parameters, effects, rows


def predict(
    observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
) -> Floats:
    """The model of the study contract, the same for every seed."""
    count = row_count(conditions)
    value = np.broadcast_to(mean(observable, conditions, parameters, effects, count), count)
    return np.tile(value, (len(seeds), 1))


def mean(observable: str, at: Conditions, given: Numbers, effects: Numbers, count: int) -> Floats:
    """One observable under n conditions, in its own unit."""
    if observable in OWN:
        return OWN[observable](at, given, effects, count)
    if observable in REDUCED:
        acting = {name: strength for name, strength in effects.items() if name in reduced.EFFECTS}
        fluid = reduced.model_mean("threshold_u_star", at, known(given), acting)
        ratio = given.get("threshold_ratio", THRESHOLD_RATIO) if REDUCED[observable] < 1.0 else 1.0
        return ratio * fluid
    if observable in reduced.OBSERVABLES:
        return reduced.model_mean(observable, at, known(given), effects)
    raise BadInput(
        f"observable = {observable!r} is not one of {', '.join((*OWN, *REDUCED, *reduced.OBSERVABLES))}"
    )


def known(given: Numbers) -> dict[str, float]:
    """Parameters of the reduced model."""
    return {path: value for path, value in given.items() if path in reduced.PARAMETERS}


def over(at: Conditions, name: str, usual: float, count: int) -> Floats:
    """A condition over its usual value, 1 where it is not stated."""
    column = at.get(name, np.full(count, np.nan))
    return np.where(np.isfinite(column), column / usual, 1.0)


def growth_with_wind(psi: float, at: Conditions, count: int) -> Floats:
    """(u* / u0)^(2 psi): at strength 1 a height grows with u*^2.

    Reference: Owen (1964), J. Fluid Mech. 20, 225: grains leave the bed with a speed of the order of u*.
    """
    return over(at, "u_star", USUAL_WIND, count) ** (2.0 * psi)


def growth_with_grains(psi: float, at: Conditions, count: int) -> Floats:
    """(d / d0)^psi: at strength 1 a height is proportional to the diameter (plausible size)."""
    return over(at, "diameter", USUAL_SAND, count) ** psi


def layer_height(at: Conditions, given: Numbers, effects: Numbers, count: int) -> Floats:
    """E-folding height of the blown layer [m]."""
    growth = growth_with_wind(effects.get("growth_with_wind", 0.0), at, count)
    return (
        given["layer_height"] * growth * growth_with_grains(effects.get("growth_with_grains", 0.0), at, count)
    )


def impact_entrainment(psi: float, at: Conditions, count: int) -> Floats:
    """sqrt(1 - psi (1 - r^2) f): the stress at the threshold falls with the share of time with transport f.

    From the fluid threshold at f = 0 to r times it at f = 1.
    Reference: Martin & Kok (2018), Geophys. Res. Lett.
    """
    share = np.nan_to_num(at.get("activity", np.zeros(count)))
    return np.sqrt(np.maximum(1.0 - psi * (1.0 - THRESHOLD_RATIO**2) * share, 0.05))


def unstable_air(psi: float, at: Conditions, count: int) -> Floats:
    """1 - psi Psi_m(z/L) / ln(z / z0): in unstable air the same stress has a slower wind, z0 = d / 30.

    Psi_m = 2 ln((1 + x) / 2) + ln((1 + x^2) / 2) - 2 arctan x + pi / 2, x = (1 - 16 z/L)^1/4, z/L < 0.
    Reference: Paulson (1970), J. Appl. Meteorol. 9, 857.
    """
    stability = np.minimum(np.nan_to_num(at.get("stability", np.zeros(count))), 0.0)
    x = (1.0 - 16.0 * stability) ** 0.25
    shift = 2.0 * np.log((1.0 + x) / 2.0) + np.log((1.0 + x**2) / 2.0) - 2.0 * np.arctan(x) + pi / 2.0
    return 1.0 - psi * shift / np.log(30.0 * ANEMOMETER / OCEANO_DIAMETER)


def threshold_wind(at: Conditions, given: Numbers, effects: Numbers, count: int) -> Floats:
    """Threshold wind at the height of the anemometer [m s-1]."""
    falling = impact_entrainment(effects.get("impact_entrainment", 0.0), at, count)
    return given["threshold_wind"] * falling * unstable_air(effects.get("unstable_air", 0.0), at, count)


def share_above(height: Floats, scale: Floats, effects: Numbers) -> Floats:
    """Share of the flux above a height [1].

    (1 + psi z / h)^(-1 / psi) for `many_heights`, exp(-z / h) without it: grains whose layers have different
    heights (generalised Pareto law); and a share of the flux in a low layer for `low_hops`.
    """
    spread, low = effects.get("many_heights", 0.0), CREEP_SHARE * effects.get("low_hops", 0.0)
    above = (1.0 + spread * height / scale) ** (-1.0 / spread) if spread > 0.0 else np.exp(-height / scale)
    return (1.0 - low) * above + low * np.exp(-height / CREEP_HEIGHT)


def flux_density_share(at: Conditions, given: Numbers, effects: Numbers, count: int) -> Floats:
    """Mean flux density of a trap over the flux [m-1]."""
    scale = given["layer_height"] * growth_with_wind(effects.get("growth_with_wind", 0.0), at, count)
    low, high = at["trap_bottom"], at["trap_top"]
    return (share_above(low, scale, effects) - share_above(high, scale, effects)) / (high - low)


OWN: dict[str, Rule] = {
    "layer_height": layer_height,
    "threshold_wind_speed": threshold_wind,
    "flux_density_share": flux_density_share,
}
