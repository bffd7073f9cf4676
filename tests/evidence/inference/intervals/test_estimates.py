"""Intervals of calibrated numbers, averaged over what may be missing."""

from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from tests.evidence.linear_study import linear_problem

SHAPES = {"lift": lambda x: 2.0 + 0.0 * x, "bend": lambda x: x**2}


def test_an_effect_that_calibration_absorbs_widens_the_interval_of_a_number():
    """The effect "lift" acts like the level: nothing shows it, and the level may be lower by its action."""
    widths = []
    for listed in (SHAPES, {"bend": SHAPES["bend"]}):
        problem = linear_problem(listed, {})
        number = discover(problem, 1, problem.budget, no_progress).parameters["level"]
        widths.append(number.high - number.low)
    assert widths[0] > 1.5 * widths[1]
