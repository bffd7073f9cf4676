"""Optima and unreachable targets, against answers known beforehand."""

import numpy as np
import pytest
from textbook import unit_factors

from taichi_erosion.experiments.design import Factor, box_behnken, central_composite
from taichi_erosion.experiments.fit import Fit, fit_model
from taichi_erosion.experiments.optimise import SEPARATE, Goal, desirability, goal_desirability, optimise

RANGES = [Factor("a", 0.0, 2.0), Factor("b", 10.0, 30.0)]


def surface(response: str, law) -> Fit:
    """Exact quadratic of two coded factors, with a little noise so that intervals exist."""
    made = central_composite(RANGES, axial="faced")
    noise = 1e-6 * np.random.default_rng(1).normal(size=len(made))
    return fit_model(made.with_responses(**{response: law(*made.coded.T) + noise}), response, "quadratic")


def hill(a, b):
    return 10.0 - 4.0 * (a - 0.5) ** 2 - 2.0 * (b + 0.25) ** 2


def test_optima_on_corners_are_found_there_and_equal_ones_both():
    found = optimise([surface("y", hill)], [Goal("y", -50.0)])
    assert found.optima[0].settings == pytest.approx({"a": 0.0, "b": 30.0}, abs=1e-9)
    # a saddle has two equal optima
    found = optimise([surface("y", lambda a, b: a * b)], [Goal("y", 12.0)])
    best = [o for o in found.optima if o.desirability > found.optima[0].desirability - 1e-4]
    assert sorted(tuple(np.round(o.coded, 6)) for o in best) == [(-1.0, -1.0), (1.0, 1.0)]


def test_a_target_that_is_reached_is_met_along_a_line_of_separate_points():
    found = optimise([surface("y", hill)], [Goal("y", 8.0)])
    assert found.is_met
    best = [o for o in found.optima if o.desirability > 1.0 - 1e-6]
    assert len(best) > 3
    spreads = [float(surface("y", hill).leverage(o.coded[None, :])[0]) for o in best]
    assert spreads[0] == min(spreads)
    for k, one in enumerate(best):
        assert one.predictions["y"].value == pytest.approx(8.0, abs=1e-4)
        assert all(np.max(np.abs(one.coded - other.coded)) > SEPARATE for other in best[:k])


def test_a_target_above_the_surface_is_said_to_be_out_of_reach_with_the_nearest_value():
    found = optimise([surface("y", hill)], [Goal("y", 12.0)])
    assert not found.is_met
    (sentence,) = found.sentences
    assert "the target 12 is outside the range of this model" in sentence
    assert "the nearest value is 10 at a = 1.5, b = 17.5" in sentence
    assert found.optima[0].predictions["y"].value == pytest.approx(10.0, abs=1e-4)
    # the reach of the surface is that of a fine grid
    ticks = np.linspace(-1.0, 1.0, 201)
    grid = surface("y", hill).predict(np.array([(a, b) for a in ticks for b in ticks]))
    reach = found.reach["y"]
    # the grid misses a quadratic's top by 4 (0.005)^2
    assert reach.high == pytest.approx(grid.max(), abs=1e-3)
    assert reach.low == pytest.approx(grid.min(), abs=1e-9)


def test_two_wishes_that_exclude_each_other_are_called_so():
    fits = [surface("y", lambda a, b: a), surface("z", lambda a, b: -a)]
    found = optimise(fits, [Goal("y", 0.5), Goal("z", 0.5)])
    assert not found.is_met
    assert "no point reaches all of them" in found.sentences[0]
    assert found.optima[0].coded[0] == pytest.approx(0.0, abs=1e-3)
    # two that agree are both met
    fits = [surface("y", lambda a, b: a + b), surface("z", lambda a, b: a - b)]
    found = optimise(fits, [Goal("y", 0.5), Goal("z", 0.1)])
    assert found.is_met
    assert found.optima[0].coded == pytest.approx([0.3, 0.2], abs=1e-4)


def test_desirability_is_that_of_derringer_and_suich():
    high, aimed = Goal("y", 10.0, 0.0, 10.0), Goal("z", 5.0, 0.0, 5.0)
    values = {high: [2.5, 10.0, -1.0], aimed: [2.5, 5.0, 5.0]}
    shares = np.column_stack([goal_desirability(goal, np.array(found)) for goal, found in values.items()])
    # geometric mean of 0.25 and 0.5; both met; the first below its limit
    assert desirability(shares) == pytest.approx([np.sqrt(0.25 * 0.5), 1.0, 0.0], rel=1e-12)


def test_three_factors_are_searched_as_two():
    made = box_behnken(unit_factors("abc"))
    law = 5.0 - (made.coded - [0.2, -0.3, 0.9]) ** 2 @ [1.0, 2.0, 3.0]
    fit = fit_model(made.with_responses(y=law), "y", "quadratic")
    assert optimise([fit], [Goal("y", 12.0)]).optima[0].coded == pytest.approx([0.2, -0.3, 0.9], abs=1e-4)
