"""Impact thresholds as the simulator has them: a model that answers from the sands of saturated.csv.

    u* = A(d) sqrt((s - 1) g d) prod_e (A_e(d) / A(d))^psi_e

with d the diameter [m], s the density of the grains over that of the air [1], A and A_e the simulated numbers
without an effect and with it at textbook strength, psi_e its strength [1]. Their logarithms are straight in
ln d between simulated sands. Beyond the sands that were simulated with it an effect does what it does at the
last of them; adhesion fades there with pull over weight, as d^-2. That light grains need the root of s - 1 is
what one of them, simulated by itself, confirms within 8 %.
Three errors of the laboratory need no run: grains of another diameter than their sieve's, of another density
than is stated, and a friction velocity that is read wrongly.

Studies name it: `model = "wind.answers:predict"`. How far the lines through few winds leave the sands open
is its covariance.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from doe.common.cases import Found, Row, by_case, read_rows
from doe.wind.saturated_sand import (
    AIR,
    ALL_FORCES,
    BARE,
    GRAVITY,
    IN_EVERY_CONTACT,
    LIGHT,
    MILLI,
    QUARTZ,
    STICKY,
    STRESS_LINE,
    saturated_thresholds,
)
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats
from taichi_erosion.effect_library import friction_velocity_calibration, grain_density, sieve_diameter

READS = ("saturated.csv",)
OBSERVABLE = "threshold_u_star"
ADHESION = "dry_adhesion"
SIEVE, WEIGHT, READING = "sieve_diameter", "grain_density", "friction_velocity_calibration"
GROUPS = {ADHESION: STICKY}  # of the table, where it has not the name of the effect
FADING = {ADHESION: -2.0}  # power of d with which an effect fades beyond its coarsest sand
FREEDOM = 2.0  # of a line through four winds
PRIOR_FREEDOM = 6.0  # with which the error of one line is drawn to that of all
SLACK = 0.01  # of a diameter, by which a sand may lie beyond the simulated ones [1]


@dataclass(frozen=True)
class Sands:
    """Simulated sands of one group, in order of diameter."""

    log_diameter: Floats  # ln(d / 1 m)
    log_number: Floats  # ln A
    variance: Floats  # of ln A

    def weights(self, log_diameter: Floats) -> Floats:
        """Shares [row, sand] of the sands in their straight lines; beyond them the last one."""
        corners = np.eye(self.log_diameter.size)
        return np.array([np.interp(log_diameter, self.log_diameter, corner) for corner in corners]).T


def scale(diameter: Floats, density: Floats | float) -> Floats:
    """sqrt((s - 1) g d) [m s-1]."""
    return np.sqrt((density / AIR - 1.0) * GRAVITY * diameter)


def sands_of(thresholds: Found, group: str) -> Sands:
    """Sands of one group; errors that few winds leave are drawn to the mean of groups of several sands."""
    lines = [case for (own, _), case in thresholds.items() if own != ALL_FORCES]
    pooled = np.mean([relative_variance(case[STRESS_LINE]) for case in lines])
    chosen = {float(label): case[STRESS_LINE] for (own, label), case in thresholds.items() if own == group}
    rows = [chosen[size] for size in sorted(chosen)]
    diameter = MILLI * np.array(sorted(chosen))
    number = np.array([row.value for row in rows]) / scale(diameter, QUARTZ)
    own = np.array([relative_variance(row) for row in rows])
    variance = (PRIOR_FREEDOM * pooled + FREEDOM * own) / (PRIOR_FREEDOM + FREEDOM)
    return Sands(np.log(diameter), np.log(number), variance)


def relative_variance(row: Row) -> float:
    """Squared error of a threshold over its square [1]."""
    return (row.standard_error / row.value) ** 2


THRESHOLDS = saturated_thresholds(by_case(read_rows(Path(__file__).with_name(READS[0]))))
SIMULATED = {
    group: sands_of(THRESHOLDS, group)
    for group in {name[0] for name in THRESHOLDS} - {LIGHT, IN_EVERY_CONTACT}
}


def predict(observable, conditions, parameters, effects, seeds):
    """Impact thresholds [m s-1], the same for every seed; NaN beyond the simulated sands."""
    diameter, reading = true_diameter(conditions, effects), read(effects)
    known = SIMULATED[BARE].log_diameter
    lowest, highest = np.exp(known[[0, -1]]) * (1.0 - SLACK, 1.0 + SLACK)
    inside = (diameter >= lowest) & (diameter <= highest)
    parts = shares(diameter, effects)
    number = np.exp(sum(share @ SIMULATED[group].log_number for group, share in parts.items()))
    threshold = reading * number * scale(diameter, true_density(conditions, effects))
    return np.tile(np.where(inside, threshold, np.nan), (len(seeds), 1))


def predict_covariance(observable, conditions, parameters, effects):
    """Covariance of the errors of `predict` [m2 s-2]: sands have their own, which rows between them share."""
    value = predict(observable, conditions, parameters, effects, (0,))[0]
    parts = shares(true_diameter(conditions, effects), effects)
    own = sum((share * SIMULATED[group].variance) @ share.T for group, share in parts.items())
    return own * np.outer(value, value)


def shares(diameter: Floats, effects: dict[str, float]) -> dict[str, Floats]:
    """What ln A of every simulated sand counts for [group -> (row, sand)]."""
    bare, at = SIMULATED[BARE], np.log(diameter)
    parts = {BARE: bare.weights(at)}
    for name, strength in acting(effects).items():
        group = GROUPS.get(name, name)
        sands = SIMULATED[group]
        beyond = np.maximum(at - sands.log_diameter[-1], 0.0)
        share = strength * np.exp(FADING.get(name, 0.0) * beyond)[:, np.newaxis] * sands.weights(at)
        parts[group] = share
        parts[BARE] = parts[BARE] - share @ bare.weights(sands.log_diameter)
    return parts


def acting(effects: dict[str, float]) -> dict[str, float]:
    """Strengths of the effects that runs have to tell of."""
    found = {k: psi for k, psi in effects.items() if psi != 0.0 and k not in (SIEVE, WEIGHT, READING)}
    for name in found:
        if GROUPS.get(name, name) not in SIMULATED:
            raise BadInput(f"{READS[0]}: no sand was simulated with {name}")
    return found


def true_diameter(conditions: dict[str, Floats], effects: dict[str, float]) -> Floats:
    """Diameter [m] where that of the table is the sieve's."""
    ratio = sieve_diameter.Params().ratio
    return conditions["diameter"] * (1.0 + effects.get(SIEVE, 0.0) * (ratio - 1.0))


def read(effects: dict[str, float]) -> float:
    """Friction velocity as it is read over the true one [1]."""
    gauge = friction_velocity_calibration
    return gauge.read(gauge.Params(), effects.get(READING, 0.0), {}, OBSERVABLE, 1.0)


def true_density(conditions: dict[str, Floats], effects: dict[str, float]) -> Floats:
    """Density of the grains [kg m-3] where what is stated may be wrong; quartz where none is."""
    stated = conditions.get("grain_density", np.full_like(conditions["diameter"], np.nan))
    stated = np.where(np.isfinite(stated), stated, QUARTZ)
    solid = grain_density.Params()
    true = solid.solid_density * (1.0 - solid.porosity)
    return stated + effects.get(WEIGHT, 0.0) * (true - stated)
