"""The race on cases with a known truth: what is named, how often, and changes that must change no answer.

The cases behind the published figures are those of doe/trials; here some others keep watch.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from doe.trials.reduced.families import FAMILIES, Drawn
from doe.trials.reduced.laboratory import CaseModel
from taichi_erosion.evidence.answers.summary import race_record
from taichi_erosion.evidence.data.problem import Candidate, Numbers, Problem
from taichi_erosion.evidence.race.decision import Decision, decide_cause
from taichi_erosion.evidence.race.posterior import Posterior, infer, quantiles
from taichi_erosion.evidence.record import Record
from tests.evidence.linear_study import linear_problem

NULL, SINGLE, UNLISTED, NOISY = 1, 33, 113, 2  # cases of one seed of clean ones


@cache
def case(number: int) -> Drawn:
    return FAMILIES["clean"](4242, number)


@cache
def answered(number: int) -> tuple[Posterior, Decision]:
    posterior = infer(case(number).problem, number)
    return posterior, decide_cause(posterior)


@pytest.mark.parametrize("number", [NULL, NOISY])
def test_nothing_is_named_where_nothing_is_missing(number):
    posterior, found = answered(number)
    assert found.verdict == "none_detected"
    assert found.named == found.group == found.acting_mechanisms == ()
    assert found.probabilities["none"] > 0.5
    assert posterior.race.model.settings <= 600
    assert posterior.race.model.noisy == (number == NOISY), "which takes many seeds"


def test_the_effect_that_acts_is_named_with_its_strength():
    posterior, found = answered(SINGLE)
    (name, strength), *_ = case(SINGLE).truth["effects"].items()
    assert found.named == (name,)
    low, _, high = quantiles(*posterior.strength_draws(name))
    assert low < strength < high < posterior.race.model.largest_strength(name)


def test_what_no_list_holds_is_told_as_such():
    _, found = answered(UNLISTED)
    assert (found.verdict, found.named) == ("outside_library", ())


def test_a_twin_of_what_acts_makes_a_group():
    problem = case(SINGLE).problem
    (name,) = case(SINGLE).truth["effects"]

    class Twinned:
        def __call__(self, observable, conditions, parameters, effects: Numbers, seeds):
            effects = dict(effects)
            effects[name] += effects.pop("twin")
            return problem.model(observable, conditions, parameters, effects, seeds)

    twins = replace(problem, model=Twinned(), candidates=(*problem.candidates, Candidate("twin")))
    found = decide_cause(infer(twins, SINGLE))
    assert (set(found.group), found.named) == ({name, "twin"}, ())


def test_an_answer_at_the_cap_is_told_as_such():
    posterior = infer(case(SINGLE).problem, SINGLE, most=100)
    assert posterior.race.out_of_budget
    assert (posterior.race.model.settings, race_record(posterior).stopped) == (100, "budget")
    assert decide_cause(posterior).probabilities["none"] < 0.1  # what is known by then already


def test_a_number_that_repeats_leave_to_a_level_keeps_its_width():
    posterior, _ = answered(NULL)
    values, weight = posterior.number_draws
    truth = case(NULL).truth["parameters"]
    for axis, column in zip(posterior.race.prepared.parameter_axes, values.T, strict=True):
        low, _, high = quantiles(column, weight, (0.005, 0.5, 0.995))
        assert low < truth[axis.name] < high


def test_a_strength_beyond_the_limit_of_the_list_lies_in_its_interval():
    problem = linear_problem({"wave": lambda x: np.sin(3.0 * x)}, {"wave": 5.0})
    strength = race_record(infer(problem, 0)).effects["wave"].strength_range
    assert 3.0 < strength.low < strength.value < strength.high
    assert strength.low < 5.0 < strength.high


WATCHED = 5000  # seed of the clean cases watched here
NULLS = (0, 2, 3, 4, 6, 7, 8, 10, 11, 15)
ACTING = (26, 29, 33, 34, 42, 46, 12, 16, 25, 40)  # the last four: no list holds it
STRONG = (7, 15)  # seed and number of a case with one strong effect


@pytest.mark.slow
def test_hardly_any_name_is_false_and_none_where_nothing_is_missing():
    cases = {number: FAMILIES["clean"](WATCHED, number) for number in (*NULLS, *ACTING)}
    found = {number: race_record(infer(drawn.problem, number)) for number, drawn in cases.items()}
    told = {number: {*each.named, *each.group} for number, each in found.items()}
    assert not any(told[number] for number in NULLS)
    assert sum(bool(told[number]) for number in ACTING) >= 3
    true = {number: set(drawn.truth["effects"]) for number, drawn in cases.items()}
    assert sum(bool(told[number]) and not told[number] & true[number] for number in ACTING) <= 1


@cache
def exact() -> Problem:
    """A strong case whose model has no scatter, so that answers may not differ by a seed."""
    problem = FAMILIES["clean"](*STRONG).problem
    return replace(problem, model=CaseModel(0.0, 0.0, problem.model.aliases))


@cache
def plain() -> Record:
    return race_record(infer(exact(), 1))


def reordered(problem: Problem) -> Problem:
    order = np.random.default_rng(3).permutation(problem.visible_rows().size)
    rows = problem.visible_rows().pick_rows_at(order)
    hidden = replace(problem.vault, rows=np.zeros(0, dtype=np.int64))
    return replace(problem, measurements=rows, candidates=problem.candidates[::-1], vault=hidden)


def in_kilometres(problem: Problem) -> Problem:
    """Conditions, and the model that takes them, in thousandths of their unit."""

    def model(observable, conditions, parameters, effects, seeds):
        there = {name: 1e3 * column for name, column in conditions.items()}
        return problem.model(observable, there, parameters, effects, seeds)

    columns = {name: 1e-3 * column for name, column in problem.measurements.conditions.items()}
    return replace(problem, measurements=replace(problem.measurements, conditions=columns), model=model)


def renamed(problem: Problem) -> Problem:
    """Candidates of other names, which sort in another order."""
    new = {each.name: f"effect {10 + k}" for k, each in enumerate(problem.candidates)}
    model = CaseModel(0.0, 0.0, {alias: name for name, alias in new.items()})
    return replace(problem, candidates=tuple(map(Candidate, new.values())), model=model)


@pytest.mark.parametrize("change", [reordered, in_kilometres, renamed])
def test_order_units_and_names_do_not_matter(change: Callable[[Problem], Problem]):
    one, other = plain(), race_record(infer(change(exact()), 1))
    assert one.verdict == other.verdict == "present"
    (name,), (told,) = one.named, other.named
    assert told == (f"effect {10 + exact().candidate_names.index(name)}" if change is renamed else name)
    assert one.effects[name].strength == pytest.approx(other.effects[told].strength, rel=0.03)
