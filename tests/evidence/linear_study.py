"""A linear study whose answers are known in closed form: one observable, one condition, a level, some shapes.

y(x) = level + sum_k strength_k shape_k(x),    sd of every row as given, twelve groups of one row or more
"""

from collections.abc import Callable, Mapping

import numpy as np

from doe.trials.reduced.laboratory import Readings, table_of
from taichi_erosion.evidence.data.problem import Candidate, Parameter, Problem

LEVEL_SD = 5.0  # prior sd of the level: a quarter of its range


def linear_problem(
    shapes: Mapping[str, Callable[[np.ndarray], np.ndarray]],
    truth: Mapping[str, float],
    sd: float = 0.1,
    count: int = 24,
    seed: int | None = 0,
    calibrated: bool = True,
) -> Problem:
    """Measurements with noise from a seed, exact ones for None; `calibrated`: the level is a free number."""
    x = np.linspace(-1.0, 1.0, count)

    def model(observable, conditions, parameters, effects, seeds):
        value = parameters.get("level", 0.0) + sum(
            strength * shapes[name](conditions["x"]) for name, strength in effects.items()
        )
        return np.repeat((value + np.zeros(conditions["x"].size))[np.newaxis], seeds.size, axis=0)

    exact = sum((strength * shapes[name](x) for name, strength in truth.items()), np.zeros(count))
    noise = np.zeros(count) if seed is None else sd * np.random.default_rng(seed).standard_normal(count)
    group = tuple(f"g{k % 12}" for k in range(count))
    table = table_of([Readings("y", {"x": x}, exact + noise, np.full(count, sd), group)])
    level = (Parameter("level", 0.0, -2.0 * LEVEL_SD, 2.0 * LEVEL_SD),) if calibrated else ()
    return Problem(table, {}, level, tuple(Candidate(name) for name in shapes), model)
