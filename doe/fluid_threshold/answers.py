"""Fluid thresholds as the simulator has them: a model that answers from the beds of beds.csv.

    u* = A(d) sqrt((s - 1) g d) prod_e r_e^psi_e

with d the diameter [m], s the density of the grains over that of the air [1], A = u* / sqrt((s - 1) g d) of
beds under drag alone, ln A straight in ln d between simulated diameters; psi_e the strength of an effect, and
r_e the ratio of the thresholds with it and without it. Its logarithm is that of the beds of one diameter in
which it is switched off while all others act, times one number for all effects with which together they give
what beds with all of them have there (forces that act together do less than the product of each alone). Two
errors of a laboratory need no run: grains of another diameter than their sieve's, and a friction velocity
that is read wrongly. Beyond the simulated diameters there is no value.

Studies name it: `model = "fluid_threshold.answers:predict"`. How far few beds leave A open is its covariance.
"""

from collections.abc import Mapping
from functools import cache
from math import log

import numpy as np

from doe.fluid_threshold.cases import BARE, FORCES, MILLI, SHARED, WITH, WITHOUT, read_beds
from doe.fluid_threshold.page import Found, found_in, pooled
from taichi_erosion.core.setup import Floats
from taichi_erosion.effects import friction_velocity_calibration, sieve_diameter
from taichi_erosion.measures.threshold import Bracket
from taichi_erosion.verification.reference.hopping import GRAVITY, Sand

OBSERVABLE = "threshold_u_star"
SIEVE, READING = "sieve_diameter", "friction_velocity_calibration"
QUARTZ = Sand(0.25e-3).density  # kg m-3
AIR = Sand(0.25e-3).air  # kg m-3, of the simulated beds
SLACK = 0.01  # of a diameter, by which a sand may lie beyond the simulated ones [1]


@cache
def known() -> Found:
    """All simulated beds."""
    return found_in(read_beds())


@cache
def sands() -> tuple[Floats, Floats, Floats]:
    """Ln d [m], ln A and its variance of the beds under drag alone, in order of diameter."""
    rows = []
    for case in known():
        kind, size = case.split("/")
        if kind == BARE:
            value = pooled(known(), case)
            assert value is not None
            diameter = MILLI * float(size)
            error = value.sd / value.value / max(value.n, 1) ** 0.5
            rows.append((log(diameter), log(value.value / Sand(diameter).scale), error**2))
    table = np.array(sorted(rows)).reshape(-1, 3)
    return table[:, 0], table[:, 1], table[:, 2]


@cache
def log_ratios() -> dict[str, float]:
    """Ln r of every force that was switched off, by the name of its effect; together that of all."""
    whole, bare = (known()[f"{kind}/{SHARED:g}"] for kind in (WITH, BARE))
    off = {effect: known().get(f"{WITHOUT}{force}/{SHARED:g}") for force, effect in FORCES.items()}
    alone = {name: mean_log(whole, beds) for name, beds in off.items() if beds}
    together = mean_log(whole, bare)
    spread = together / sum(alone.values())
    return {name: spread * value for name, value in alone.items()}


def mean_log(one: Mapping[int, Bracket], other: Mapping[int, Bracket]) -> float:
    """Mean over common beds of ln(one / other) [1]."""
    return float(np.mean([log(one[seed].middle / other[seed].middle) for seed in set(one) & set(other)]))


def true_diameter(conditions: dict[str, Floats], effects: dict[str, float]) -> Floats:
    """Diameter [m] where that of the table is the sieve's."""
    ratio = sieve_diameter.Params().ratio
    return conditions["diameter"] * (1.0 + effects.get(SIEVE, 0.0) * (ratio - 1.0))


def weights(diameter: Floats) -> Floats:
    """Shares [row, sand] of the simulated diameters in every row."""
    places = sands()[0]
    return np.array([np.interp(np.log(diameter), places, corner) for corner in np.eye(places.size)]).T


def predict(observable, conditions, parameters, effects, seeds):
    """Fluid thresholds [m s-1], the same for every seed; NaN beyond the simulated diameters."""
    diameter = true_diameter(conditions, effects)
    places, numbers, _ = sands()
    ends = np.exp(places[[0, -1]]) * (1.0 - SLACK, 1.0 + SLACK)
    air = conditions.get("air_density", np.full_like(diameter, AIR))
    scale = np.sqrt((QUARTZ / air - 1.0) * GRAVITY * diameter)
    factor = sum(effects.get(name, 0.0) * value for name, value in log_ratios().items())
    gauge = friction_velocity_calibration
    reading = gauge.read(gauge.Params(), effects.get(READING, 0.0), {}, OBSERVABLE, 1.0)
    value = reading * scale * np.exp(weights(diameter) @ numbers + factor)
    inside = (diameter >= ends[0]) & (diameter <= ends[1])
    return np.tile(np.where(inside, value, np.nan), (len(seeds), 1))


def predict_covariance(observable, conditions, parameters, effects):
    """Covariance of the errors of `predict` [m2 s-2]: rows share the diameters between which they lie."""
    value = predict(observable, conditions, parameters, effects, (0,))[0]
    share = weights(true_diameter(conditions, effects))
    return (share * sands()[2]) @ share.T * np.outer(value, value)
