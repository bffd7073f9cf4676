"""What an effect does to the model: where it acts most, and whether its source has it go that way."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.evidence.answers.effect_action import effect_actions, opposed_signs
from taichi_erosion.evidence.data.problem import Problem
from taichi_erosion.evidence.inference.map_fit import Fit
from taichi_erosion.evidence.models.prepared_problem import prepare
from tests.evidence.linear_study import linear_problem

SHAPES = {"rising": lambda x: x, "raising": lambda x: 1.0 + 0.5 * x}


def problem(**expected: int) -> Problem:
    """Exact values of sd 0.1 that both effects could explain, with the way of each in its source."""
    made = linear_problem(SHAPES, {"raising": 1.0}, seed=None)
    candidates = [
        replace(each, expected=(("y", expected[each.name]),) if each.name in expected else ())
        for each in made.candidates
    ]
    return replace(made, candidates=tuple(candidates))


def acting(*names: str, strength: float = 1.0) -> Fit:
    return Fit(names, np.zeros(1), np.full(len(names), strength), 0.0)


def test_an_effect_acts_most_where_it_moves_a_row_most_all_else_the_same():
    prepared = prepare(made := problem(), made.measurements, 1)
    (name, action), *others = effect_actions(prepared, acting("raising")).items()
    assert (name, others, action.observable) == ("raising", [], "y")
    assert (action.without, action.acting) == pytest.approx((0.0, 1.5))
    assert action.conditions == {"x": 1.0}


@pytest.mark.parametrize(("sign", "count"), [(1, 0), (-1, 1)])
def test_an_effect_that_moves_an_observable_against_its_source_is_told(sign: int, count: int):
    prepared = prepare(made := problem(raising=sign), made.measurements, 1)
    told = opposed_signs(prepared, acting("raising"))
    assert len(told) == count
    for each in told:
        # 1.5 where it acts most, of an error of 0.1
        assert each.moved_sd == pytest.approx(15.0)
        assert (each.effect, each.observable, each.expected) == ("raising", "y", -1)


def test_an_effect_that_goes_both_ways_is_judged_by_all_rows():
    prepared = prepare(made := problem(rising=1), made.measurements, 1)
    assert opposed_signs(prepared, acting("rising")) == ()  # as many rows up as down, none of it against
