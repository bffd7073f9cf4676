"""The race on cases with a known truth: what is named, what is not, and what it may cost."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from doe.trials.reduced.families import FAMILIES, Drawn
from taichi_erosion.evidence.data.problem import Candidate, Numbers
from taichi_erosion.evidence.race.decision import Decision, decide
from taichi_erosion.evidence.race.posterior import Posterior, quantiles, raced
from taichi_erosion.evidence.race.summary import summary
from tests.evidence.linear_study import linear_problem

NULL, SINGLE, UNLISTED, NOISY = 1, 33, 113, 2  # cases of one seed of clean ones


@cache
def case(number: int) -> Drawn:
    return FAMILIES["clean"](4242, number)


@cache
def answered(number: int) -> tuple[Posterior, Decision]:
    posterior = raced(case(number).problem, number)
    return posterior, decide(posterior)


@pytest.mark.parametrize("number", [NULL, NOISY])
def test_nothing_is_named_where_nothing_is_missing(number):
    posterior, found = answered(number)
    assert found.verdict == "none_detected"
    assert found.named == found.group == found.mechanisms == ()
    assert found.none > 0.5
    assert posterior.race.model.settings <= 600
    assert posterior.race.model.noisy == (number == NOISY), "which takes many seeds"


def test_the_effect_that_acts_is_named_with_its_strength():
    posterior, found = answered(SINGLE)
    (name, strength), *_ = case(SINGLE).truth["effects"].items()
    assert found.named == (name,)
    low, _, high = quantiles(*posterior.strength(name))
    assert low < strength < high < posterior.race.model.largest(name)


def test_what_no_list_holds_is_told_as_such():
    _, found = answered(UNLISTED)
    assert found.verdict == "outside_library"
    assert found.named == ()


def test_a_twin_of_what_acts_makes_a_group():
    problem = case(SINGLE).problem
    (name,) = case(SINGLE).truth["effects"]

    class Twinned:
        def __call__(self, observable, conditions, parameters, effects: Numbers, seeds):
            effects = dict(effects)
            effects[name] += effects.pop("twin")
            return problem.model(observable, conditions, parameters, effects, seeds)

    twins = replace(problem, model=Twinned(), candidates=(*problem.candidates, Candidate("twin")))
    found = decide(raced(twins, SINGLE))
    assert set(found.group) == {name, "twin"}
    assert found.named == ()


def test_an_answer_at_the_cap_is_told_as_such():
    posterior = raced(case(SINGLE).problem, SINGLE, most=60)
    assert posterior.race.stopped
    assert posterior.race.model.settings == 60
    assert summary(posterior).cost.stopped == "budget"
    assert decide(posterior).none < 0.1  # what is known by then already


def test_a_number_that_repeats_leave_to_a_level_keeps_its_width():
    posterior, _ = answered(NULL)
    values, weight = posterior.numbers
    truth = case(NULL).truth["parameters"]
    for axis, column in zip(posterior.race.prepared.axes, values.T, strict=True):
        low, _, high = quantiles(column, weight, (0.005, 0.5, 0.995))
        assert low < truth[axis.name] < high


def test_a_strength_beyond_the_limit_of_the_list_lies_in_its_interval():
    problem = linear_problem({"wave": lambda x: np.sin(3.0 * x)}, {"wave": 5.0})
    strength = summary(raced(problem, 0)).effects["wave"].strength
    assert 3.0 < strength.low < strength.value < strength.high
    assert strength.low < 5.0 < strength.high
