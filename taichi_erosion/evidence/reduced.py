"""A wind-erosion model in closed form: threshold, flux and angle of repose in microseconds.

    u*t = A sqrt((rho_p / rho - 1) g d)                                         [m s-1]
    Q   = C (rho / g) u*t (u*^2 - u*t^2),  0 below the threshold                [kg m-1 s-1]
    a   = arctan(mu_s) + 15 mu_r                                                [deg]

times what the effects of `reduced_effects.py` add. It teaches what an evidence study is, and tests the
statistics; use it as `model = "taichi_erosion.evidence.reduced:predict"`.

Observables: threshold_u_star, flux, repose_angle. Parameters: threshold_coefficient A, flux_coefficient C,
friction_sliding mu_s, friction_rolling mu_r. Conditions: the keys of DEFAULTS, which also say what is assumed
when one is not given.

Reference: Bagnold (1941) for the threshold, Ungar & Haff (1987), Sedimentology 34, 289, for the flux.
"""

from math import isfinite

import numpy as np
from scipy.special import ndtri

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.problem import Conditions, Floats, Integers
from taichi_erosion.evidence.reduced_effects import AIR_DENSITY, DEFAULTS, EFFECTS, GRAIN_DENSITY, GRAVITY

OBSERVABLES = ("threshold_u_star", "flux", "repose_angle")
PARAMETERS = {
    "threshold_coefficient": 0.1,
    "flux_coefficient": 1.5,
    "friction_sliding": 0.5,
    "friction_rolling": 0.1,
}
SCATTER = {
    "threshold_u_star": 0.02,
    "flux": 0.08,
    "repose_angle": 0.5,
}  # of one seed: relative, relative, deg
DEFAULT_COLUMNS: Conditions = {name: np.asarray(value) for name, value in DEFAULTS.items()}
DEGREES_PER_ROLLING = 15.0  # deg per unit of rolling friction, from heaps of spheres


def predict(
    observable: str,
    conditions: dict[str, Floats],
    parameters: dict[str, float],
    effects: dict[str, float],
    seeds: Integers,
) -> Floats:
    """The model of the study contract: one observable, n conditions, r seeds -> (r, n), paired by seed."""
    value = expected(observable, conditions, parameters, effects)
    kick = SCATTER[observable] * disturbance(observable, conditions, seeds)
    return value + kick if observable == "repose_angle" else value * np.exp(kick)


def expected(
    observable: str, conditions: Conditions, parameters: dict[str, float], effects: dict[str, float]
) -> Floats:
    """The model without its scatter."""
    at = complete_conditions(conditions)
    given = {**PARAMETERS, **parameters}
    shifts = [EFFECTS[name](psi, at) for name, psi in effects.items() if psi != 0.0]
    if observable == "repose_angle":
        angle = np.degrees(np.arctan(given["friction_sliding"]))
        bare = angle + DEGREES_PER_ROLLING * given["friction_rolling"]
        return bare + sum((shift.repose for shift in shifts), start=np.zeros(row_count(conditions)))
    weight = (GRAIN_DENSITY / AIR_DENSITY - 1.0) * GRAVITY * at["diameter"]
    threshold = given["threshold_coefficient"] * np.sqrt(weight)
    threshold = threshold * np.exp(sum((shift.threshold for shift in shifts), start=0.0))
    if observable == "threshold_u_star":
        return threshold * np.ones(row_count(conditions))
    if observable != "flux":
        raise BadInput(f"reduced model: observable = {observable!r} is not one of {', '.join(OBSERVABLES)}")
    excess = np.maximum(at["u_star"] ** 2 - threshold**2, 0.0)
    flux = given["flux_coefficient"] * AIR_DENSITY / GRAVITY * threshold * excess
    return flux * np.exp(sum((shift.flux for shift in shifts), start=np.zeros(row_count(conditions))))


def complete_conditions(conditions: Conditions) -> Conditions:
    """Conditions with the default where one is not given or not known; a default alone stays one number."""
    complete = dict(DEFAULT_COLUMNS)
    for name, column in conditions.items():
        missing = not isfinite(np.add.reduce(column))  # one pass, where most columns are complete
        known = np.isfinite(column) if missing else None
        complete[name] = column if known is None else np.where(known, column, DEFAULTS.get(name, 0.0))
    return complete


def row_count(conditions: Conditions) -> int:
    """Number of rows; one where no condition is given."""
    return next((column.size for column in conditions.values()), 1)


def disturbance(observable: str, conditions: Conditions, seeds: Integers) -> Floats:
    """Standard normal number of every (seed, condition), the same whatever the parameters and effects."""
    return disturbance_of(row_states(observable, conditions), seeds)


def disturbance_of(rows: np.ndarray, seeds: Integers) -> Floats:
    """Standard normal numbers (seeds, rows) of rows in their states."""
    grid = scrambled(rows[np.newaxis, :] ^ scrambled(np.asarray(seeds).astype(np.uint64))[:, np.newaxis])
    uniform = (np.right_shift(grid, np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53
    return ndtri(uniform)


def row_states(observable: str, conditions: Conditions) -> np.ndarray:
    """A number for every row that its observable and conditions make.

    A hash of the bits, so that the order of rows does not matter. Reference: the finaliser of Steele, Lea &
    Flood (2014), OOPSLA, fig. 15 (splitmix64).
    """
    size = row_count(conditions)
    state = np.full(size, OBSERVABLES.index(observable) + 1, dtype=np.uint64)
    for name in sorted(conditions):
        state = scrambled(state ^ np.asarray(conditions[name], dtype=np.float64).view(np.uint64))
    return state


def scrambled(state: np.ndarray) -> np.ndarray:
    """One step of splitmix64: every bit of the result depends on every bit of the state."""
    state = state + np.uint64(0x9E3779B97F4A7C15)
    state = (state ^ np.right_shift(state, np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ np.right_shift(state, np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ np.right_shift(state, np.uint64(31))
