"""Cases of two observables of one run with correlated scatter, told to be of one run or not."""

from dataclasses import replace

import numpy as np

from doe.trials.reduced.laboratory import Readings, table_of
from taichi_erosion.evidence.data.problem import (
    Candidate,
    Conditions,
    Floats,
    Integers,
    Numbers,
    Observable,
    Parameter,
    Problem,
)
from taichi_erosion.evidence.models import reduced

OBSERVABLES = ("threshold_u_star", "flux")
CANDIDATES = (
    "dry_cohesion",
    "liquid_bridge",
    "saffman_lift",
    "sheltering",
    "electrostatics",
    "mid_air_collisions",
)
CELLS, REPEATS = 16, 3
SCATTER = (0.03, 0.1)  # sd of ln of threshold and of flux, of single runs
PRIOR_SD = 0.2  # of ln of a calibrated number
STRENGTH = (0.5, 3.0)  # log-uniform


def model(
    observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
) -> Floats:
    """The closed-form model without scatter."""
    value = reduced.expected(observable, conditions, parameters, effects)
    return np.repeat(value[np.newaxis], seeds.size, axis=0)


def draw(
    seed: int, number: int, correlation: float, with_effect: bool, told: bool = True
) -> tuple[Problem, dict[str, dict[str, float]]]:
    """Runs at conditions drawn anew, three at each, and what was put in: `parameters` and `effects`."""
    random = np.random.default_rng([seed, number, round(100 * (1 + correlation)), with_effect])
    at = {
        "diameter": np.exp(random.uniform(np.log(1.5e-4), np.log(5e-4), CELLS)),
        "moisture": random.choice([0.0, 0.002, 0.005, 0.01], CELLS),
        "spread": random.uniform(1.2, 2.5, CELLS),
        "u_star": random.uniform(0.7, 1.0, CELLS),
    }
    at = {name: np.repeat(column, REPEATS) for name, column in at.items()}
    starts = {"threshold_coefficient": 0.1, "flux_coefficient": 1.5}
    parameters = {k: v * float(np.exp(PRIOR_SD * random.standard_normal())) for k, v in starts.items()}
    low, high = np.log(STRENGTH)
    name, strength = str(random.choice(CANDIDATES)), float(np.exp(random.uniform(low, high)))
    effects = {name: strength} if with_effect else {}
    root = np.linalg.cholesky([[1.0, correlation], [correlation, 1.0]])
    errors = random.standard_normal((CELLS * REPEATS, 2)) @ root.T
    cell = tuple(f"set-up {k // REPEATS}" for k in range(CELLS * REPEATS))
    parts = []
    for observable, sd, error in zip(OBSERVABLES, SCATTER, errors.T, strict=True):
        value = reduced.expected(observable, at, parameters, effects) * np.exp(sd * error)
        parts.append(Readings(observable, at, value, np.full(value.size, np.nan), cell))
    runs = tuple(f"run {k}" for k in range(CELLS * REPEATS)) * 2 if told else ()
    problem = Problem(
        replace(table_of(parts), heap=runs),
        {name: Observable(name, "log") for name in OBSERVABLES},
        tuple(Parameter(k, v, 0.2 * v, 5.0 * v, PRIOR_SD) for k, v in starts.items()),
        tuple(map(Candidate, CANDIDATES)),
        model,
    )
    return problem, {"parameters": parameters, "effects": effects}
