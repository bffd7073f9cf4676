"""A study of single heaps in closed form: two observables whose scatter is correlated."""

from dataclasses import replace

import numpy as np

from doe.trials.reduced.laboratory import Readings, table_of
from taichi_erosion.evidence.data.problem import Candidate, Observable, Parameter, Problem

CELLS, REPEATS, SLOPE_SD = 10, 3, 0.5


def model(observable, conditions, parameters, effects, seeds):
    x = conditions["x"]
    value = 3.0 + parameters["slope"] * x * (1.0 if observable == "angle" else -0.5)
    value = value + effects.get("bend", 0.0) * (x**2 if observable == "angle" else 0.3 * x)
    return np.repeat(value[np.newaxis], seeds.size, axis=0)


def heaps(seed: int, rho: float = 0.8, named: bool = True, strength: float = 0.0) -> Problem:
    """Single heaps at ten conditions, three of each, with two observables whose scatter is correlated."""
    random = np.random.default_rng(seed)
    size, x = CELLS * REPEATS, np.repeat(np.linspace(-1.0, 1.0, CELLS), REPEATS)
    errors = random.standard_normal((size, 2)) @ np.linalg.cholesky([[1.0, rho], [rho, 1.0]]).T
    acting = {"slope": 0.4}
    truth = [model(name, {"x": x}, acting, {"bend": strength}, np.zeros(1))[0] for name in ("angle", "width")]
    parts = [
        Readings(name, {"x": x}, exact + sd * error, np.full(size, sd), tuple(f"x{v:.3f}" for v in x))
        for name, sd, exact, error in zip(("angle", "width"), (0.1, 0.2), truth, errors.T, strict=True)
    ]
    heap = tuple(f"heap {k}" for k in range(size)) * 2 if named else ()
    table = replace(table_of(parts), heap=heap)
    observables = {"angle": Observable("angle", sd_shared=0.15)}
    numbers = (Parameter("slope", 0.4, 1e-9, 1e9, SLOPE_SD),)
    return Problem(table, observables, numbers, (Candidate("bend"),), model)
