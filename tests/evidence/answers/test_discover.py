"""Discovery on closed-form studies whose truth is known."""

import numpy as np

from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from tests.evidence.linear_study import linear_problem


def test_an_absent_strong_effect_is_excluded_down_to_a_small_strength():
    shapes = {"slope": lambda x: x, "wave": lambda x: np.sin(3.0 * x)}
    problem = linear_problem(shapes, {}, sd=0.1)
    found = discover(problem, 1, problem.budget, no_progress)
    x = problem.measurements.conditions["x"]
    for name, shape in shapes.items():
        effect = found.effects[name]
        assert effect.status == "excluded"
        # 95 % of a half-normal likelihood of unit sd lie below 2; a chance pull of 2 sd doubles that
        assert effect.strength_high * np.linalg.norm(shape(x)) / 0.1 < 4.5
