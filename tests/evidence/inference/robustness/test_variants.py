"""What an answer hangs on."""

import numpy as np

from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from tests.evidence.linear_study import linear_problem

SHAPES = {"bend": lambda x: x**2, "wave": lambda x: np.sin(3.0 * x)}


def test_a_clear_answer_holds_in_every_variant():
    problem = linear_problem(SHAPES, {"bend": 2.0}, sd=0.1, count=36)
    found = discover(problem, 1, problem.budget, no_progress)
    assert found.variants.holds == found.variants.count > 10
