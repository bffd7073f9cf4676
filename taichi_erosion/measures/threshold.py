"""Thresholds of motion: brackets bed by bed, their pooled value, and the wind speed of a tunnel."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, hypot, log, pi, sqrt

import numpy as np
import scipy

from taichi_erosion.core.setup import Floats
from taichi_erosion.measures.boundary_layer import flat_plate_thickness, free_stream_speed_by_coles
from taichi_erosion.measures.result import Measurement, no_measurement, pool_repeats
from taichi_erosion.measures.shortfalls import few_beds_shortfall

UNIT = "m s-1"
# thresholds whose measurements hold no bracket
LINE = "impact_threshold_linear"
THRESHOLDS = (LINE, "threshold_ratio", "threshold_ratio_linear")
NOT_REACHED = "the search did not get that far, or the bed moved in its first wind"
CONFIDENCE = 0.95  # of the interval [1]
LOGISTIC_SD = pi / sqrt(3.0)  # standard deviation of the standard logistic law [1]
SCALES = np.geomspace(1e-4, 1.0, 200)  # of the law, in logarithms: from next to none to any [1]
CARRIED = 0.05  # of the largest flux [1]
LEAST_PAIRS = 4  # two more than a line needs
REACH = 1.5  # logarithms on either side of the brackets in which the ends of the interval are looked for

ROUGH = 1.0 / 30.0  # z0 over the diameter of the grains [1]
FASTEST_TUNNEL = 1e3  # m s-1
# u* of the simulated working section over that of a flat plate, by wind speed [m s-1]: doe/tunnel_map/map.csv
MAP_SPEED = (5.0, 5.5, 6.0, 6.5, 7.0, 7.5, 9.0, 11.0, 13.0)
MAP_RATIO = (1.0877, 1.0855, 1.0828, 1.0809, 1.0788, 1.0775, 1.0733, 1.0691, 1.0659)
PLATE = (1.0,) * len(MAP_SPEED)  # the same of a flat plate itself [1]
MAP_SD = 0.0562  # of u* at a stated wind, relative: doe/tunnel_map/variants.csv
CONVERSION = (
    f"by the simulated map of the working section, u* known to {MAP_SD:.1%}: +- {{shared_sd:.2f}} m/s "
    "for all beds alike; over the flat plate of textbooks {flat_plate:.2f} m/s"
)
# details of a bed that all beds share, averaged in the pooled value
SHARED = ("shared_sd", "flat_plate", "window_start", "stress_over_wind")


@dataclass(frozen=True)
class Bracket:
    """Friction velocities between which the threshold of one bed lies [m s-1]."""

    low: float
    high: float

    @property
    def middle(self) -> float:
        """Geometric mean [m s-1]."""
        return sqrt(self.low * self.high)

    @property
    def sd(self) -> float:
        """Standard deviation of a uniform law over the bracket [m s-1]."""
        return (self.high - self.low) / sqrt(12.0)


@dataclass(frozen=True)
class Tunnel:
    """Quantities that set the friction velocity at the bed of a wind tunnel, beside the wind."""

    fetch: float  # m, from the inlet
    diameter: float  # m, of the grains
    viscosity: float  # m2 s-1, kinematic
    ratio: float | None = None  # u* over the free-stream speed, where it was measured [1]


def threshold_from_bracket(name: str, bracket: Bracket | None) -> Measurement:
    """Threshold of one bed [m s-1]; `sd` is that of its bracket."""
    if bracket is None:
        return no_measurement(name, UNIT, NOT_REACHED)
    details = {"low": bracket.low, "high": bracket.high}
    return Measurement(name, bracket.middle, bracket.sd, UNIT, details=details)


def threshold_from_line(bracket: Bracket | None) -> Measurement:
    """Threshold of one bed [m s-1] from a line, which bounds nothing; `sd` is half of the bracket."""
    if bracket is None:
        return no_measurement(LINE, UNIT, "too few winds carried grains")
    return Measurement(LINE, bracket.middle, 0.5 * (bracket.high - bracket.low), UNIT)


def friction_velocity_at_zero_flux(trials: Sequence[tuple[float, float]]) -> Bracket | None:
    """Friction velocity at which the flux Q = a (u*^2 - u_t^2) of slowed-down transport would vanish.

    Least squares through pairs (u* [m s-1], Q) that carry at least `CARRIED` of the largest flux: below that
    the bed is close to rest, and Q is the tail of what blew before. The bracket is u_t with its standard
    error on either side; None where fewer than four pairs are left or the line meets zero at no wind.

    Reference: Creyssels et al. (2009), J. Fluid Mech. 625, 47, section 3.
    """
    table = np.array(trials, dtype=np.float64).reshape(-1, 2)
    table = table[table[:, 1] > CARRIED * table[:, 1].max(initial=0.0)]
    if len(table) < LEAST_PAIRS:
        return None
    stress, flux = table[:, 0] ** 2, table[:, 1]
    # of u*^2 on Q: the intercept is what is asked for, and its error comes with it
    (slope, start), covariance = np.polyfit(flux, stress, 1, cov=True)
    error = sqrt(float(covariance[1, 1]))
    return Bracket(sqrt(start - error), sqrt(start + error)) if slope > 0.0 and start > error else None


def ratio(name: str, impact: Measurement, fluid: Measurement) -> Measurement:
    """Impact over fluid threshold of one bed [1], between the ends of their brackets where both have one."""
    if not (impact.n and fluid.n):
        return no_measurement(name, "1", "a threshold is missing")
    value, ends, others = impact.value / fluid.value, impact.details, fluid.details
    details = {}
    if ends and others:
        details = {"low": ends["low"] / others["high"], "high": ends["high"] / others["low"]}
    sd = value * hypot(impact.sd / impact.value, fluid.sd / fluid.value)
    return Measurement(name, value, sd, "1", details=details)


def free_stream(friction: float, tunnel: Tunnel, ratio: Sequence[float] = MAP_RATIO) -> float:
    """Free-stream speed U of a tunnel whose floor has the friction velocity u* [m s-1].

    U = coles_speed(u* / c(U), delta, z0),   delta = 0.37 x (U x / nu)^-0.2,   z0 = d / 30

    with x the fetch [m], d the diameter [m], and c the ratio of u* in the simulated air of the working
    section to that of a flat plate, 6 m from the inlet: straight lines between the speeds of the map, and
    constant beyond. The standard deviation of u* at a stated U is `MAP_SD` u*. A ratio of 1 (`PLATE`) gives
    the flat plate. Where the tunnel has a measured u*/U, that is all there is to it.

    Reference: Schlichting & Gersten (2017), Boundary-Layer Theory, 18.2; Coles (1956), J. Fluid Mech. 1, 191;
    doe/tunnel_map.
    """
    if tunnel.ratio is not None:
        return friction / tunnel.ratio

    def speed_mismatch(speed: float) -> float:
        depth = flat_plate_thickness(speed, tunnel.fetch, tunnel.viscosity)
        plate = friction / float(np.interp(speed, MAP_SPEED, ratio))
        return free_stream_speed_by_coles(plate, depth, ROUGH * tunnel.diameter, tunnel.viscosity) - speed

    return scipy.optimize.root_scalar(speed_mismatch, bracket=(friction, FASTEST_TUNNEL)).root


def tunnel_speed(name: str, bracket: Bracket | None, tunnel: Tunnel) -> Measurement:
    """Free-stream speed at the threshold of one bed [m s-1]; `sd` is that of its bracket.

    `details`: ends of the bracket as speeds; by the map also `shared_sd`, its standard deviation, which all
    beds share, and `flat_plate`, the speed over a flat plate.
    """
    if bracket is None:
        return no_measurement(name, UNIT, NOT_REACHED)
    low, middle, high = (free_stream(each, tunnel) for each in (bracket.low, bracket.middle, bracket.high))
    details = {"low": low, "high": high}
    if tunnel.ratio is None:
        details["shared_sd"] = free_stream(bracket.middle * (1.0 + MAP_SD), tunnel) - middle
        details["flat_plate"] = free_stream(bracket.middle, tunnel, PLATE)
    return Measurement(name, middle, middle * bracket.sd / bracket.middle, UNIT, details=details)


def pool_beds(repeats: Sequence[Measurement]) -> Measurement:
    """Pooled value of several beds: thresholds by a logistic law fitted to the brackets, all else by means.

    The share of beds that move at u* is 1 / (1 + exp(-(ln u* - ln U) / s)). Each bed has one threshold that
    lies in its bracket, so the likelihood is the product of the shares between the ends of the brackets; it
    is finite also where outcomes separate. `value` is U, at which half of the beds move, `sd` the standard
    deviation of beds and of what their brackets leave open, and `details` hold the interval from the profile
    of the likelihood with the limit n ln(1 + t^2 / (n - 1)): Student's for normal beds, as for means.
    """
    plain = pool_repeats(repeats)
    brackets = [r.details for r in repeats if {"low", "high"} <= set(r.details)]
    values_of = {key: [r.details[key] for r in repeats if key in r.details] for key in SHARED}
    shared = {key: float(np.mean(values)) for key, values in values_of.items() if values}
    counts_beds = plain.name in THRESHOLDS or brackets  # other measures lack no beds
    lacking = (*plain.shortfalls, *(few_beds_shortfall(plain) if counts_beds else ()))
    notes = (*plain.notes, CONVERSION.format(**shared)) if "shared_sd" in shared else plain.notes
    plain = replace(plain, notes=notes, shortfalls=lacking, details=plain.details | shared)
    if plain.n < 2:
        return plain
    if len(brackets) < 2:
        reach = float(scipy.special.stdtrit(plain.n - 1, 0.5 + 0.5 * CONFIDENCE)) * plain.sd / sqrt(plain.n)
        ends = {"low": plain.value - reach, "high": plain.value + reach, "confidence": CONFIDENCE}
        return replace(plain, details=plain.details | {"interval": ends})
    ends = np.log([[b["low"], b["high"]] for b in brackets])
    middle, scale, low, high = fit_logistic_law(ends)
    left_open = np.diff(ends) ** 2 / 12.0  # a uniform law over every bracket
    spread = hypot(LOGISTIC_SD * scale, float(np.sqrt(left_open.mean())))
    interval = {"low": exp(low), "high": exp(high), "confidence": CONFIDENCE, "scale": scale}
    details = plain.details | {"interval": interval}
    return replace(plain, value=exp(middle), sd=exp(middle) * spread, details=details)


def fit_logistic_law(ends: Floats) -> tuple[float, float, float, float]:
    """Most likely middle and scale of brackets [n, 2], and ends of the interval of the middle; logarithms."""

    def best_scale(middle: float) -> tuple[float, float]:
        a, b = ((ends - middle)[:, :, None] / SCALES).transpose(1, 0, 2)
        # logarithms of 1/(1+e^-b) - 1/(1+e^-a), whose terms may both be near 0 or near 1
        chances = np.log(-np.expm1(a - b)) + b - np.logaddexp(0.0, a) - np.logaddexp(0.0, b)
        heights = chances.sum(axis=0)
        k = int(np.argmax(heights))
        return float(SCALES[k]), float(heights[k])

    start = float(ends.mean())
    optimum = scipy.optimize.minimize(lambda m: -best_scale(float(m[0]))[1], [start], method="Nelder-Mead")
    middle, count = float(optimum.x[0]), len(ends)
    scale, most = best_scale(middle)
    quantile = float(scipy.special.stdtrit(count - 1, 0.5 + 0.5 * CONFIDENCE))
    limit = 0.5 * count * log(1.0 + quantile**2 / (count - 1))

    def excess(m: float) -> float:
        return most - best_scale(m)[1] - limit

    def interval_end(outer: float) -> float:
        bracket = sorted((outer, middle))
        return scipy.optimize.root_scalar(excess, bracket=bracket).root if excess(outer) > 0.0 else outer

    return middle, scale, interval_end(middle - REACH), interval_end(middle + REACH)
