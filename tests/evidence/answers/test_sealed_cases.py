"""Blind cases of the closed-form model: how often a name is right, and changes that must change no answer.

The cases behind the published figures are those of doe/trials; here some others keep watch.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from doe.trials.reduced.families import FAMILIES, Drawn
from doe.trials.reduced.laboratory import CaseModel
from taichi_erosion.evidence.data.problem import Candidate, Problem
from taichi_erosion.evidence.race.posterior import raced
from taichi_erosion.evidence.race.record import Record
from taichi_erosion.evidence.race.summary import summary
from tests.evidence.asking import SILENT

WATCHED = 5000  # seed of the clean cases watched here
NULLS = (0, 2, 3, 4, 6, 7, 8, 10, 11, 15)
SINGLES = (26, 29, 33, 34, 42, 46)
UNLISTED = (12, 16, 25, 40)
STRONG, NULL = (7, 15), (7, 4)  # seed and number of a case with one strong effect, and of one without


def case(seed: int, number: int) -> Drawn:
    return FAMILIES["clean"](seed, number)


def answer(problem: Problem, seed: int = 1) -> Record:
    return summary(raced(problem, seed))


@cache
def watched(number: int) -> tuple[Record, set[str]]:
    """What is said of a case, and what acts in it."""
    drawn = case(WATCHED, number)
    return answer(drawn.problem, number), set(drawn.truth["effects"])


def names(record: Record) -> set[str]:
    return {*record.decided.named, *record.decided.group}


@pytest.mark.slow
def test_nothing_is_named_where_nothing_is_missing():
    assert [number for number in NULLS if names(watched(number)[0])] == []


@pytest.mark.slow
def test_hardly_any_name_is_false():
    told = [watched(number) for number in (*SINGLES, *UNLISTED)]
    assert sum(bool(names(record)) for record, _ in told) >= 3
    assert sum(bool(names(record) and not names(record) & acting) for record, acting in told) <= 1


@cache
def exact() -> Problem:
    """A strong case whose model has no scatter, so that answers may not differ by a seed."""
    problem = case(*STRONG).problem
    model = problem.model
    assert isinstance(model, CaseModel)
    return replace(problem, model=CaseModel(0.0, 0.0, model.aliases))


@cache
def plain() -> Record:
    return answer(exact())


def reordered(problem: Problem) -> Problem:
    order = np.random.default_rng(3).permutation(problem.visible().size)
    rows = problem.visible().rows(order)
    hidden = replace(problem.vault, rows=np.zeros(0, dtype=np.int64))
    return replace(problem, measurements=rows, candidates=problem.candidates[::-1], vault=hidden)


def in_kilometres(problem: Problem) -> Problem:
    """Conditions, and the model that takes them, in thousandths of their unit."""

    def model(observable, conditions, parameters, effects, seeds):
        there = {name: 1e3 * column for name, column in conditions.items()}
        return problem.model(observable, there, parameters, effects, seeds)

    columns = {name: 1e-3 * column for name, column in problem.measurements.conditions.items()}
    return replace(problem, measurements=replace(problem.measurements, conditions=columns), model=model)


@pytest.mark.parametrize("change", [reordered, in_kilometres])
def test_order_and_units_do_not_matter(change: Callable[[Problem], Problem]):
    one, other = plain(), answer(change(exact()))
    assert one.decided.verdict == other.decided.verdict == "present"
    assert one.decided.named == other.decided.named
    (name,) = one.decided.named
    assert one.effects[name].strength.value == pytest.approx(other.effects[name].strength.value, rel=0.03)


def test_the_names_of_candidates_do_not_matter():
    problem = exact()
    renamed = {each.name: f"effect {10 + k}" for k, each in enumerate(problem.candidates)}
    model = CaseModel(0.0, 0.0, {new: old for old, new in renamed.items()})
    candidates = tuple(Candidate(renamed[each.name]) for each in problem.candidates)
    found = answer(replace(problem, candidates=candidates, model=model))
    assert found.decided.named == tuple(renamed[name] for name in plain().decided.named)


def test_shuffled_values_name_nothing():
    problem = case(*STRONG).problem
    table, random = problem.measurements, np.random.default_rng(5)
    order = np.arange(table.size)
    for name in set(table.observable):
        rows = np.flatnonzero([entry == name for entry in table.observable])
        order[rows] = random.permutation(rows)
    shuffled = replace(table, value=table.value[order], sd=table.sd[order])
    assert not names(answer(replace(problem, measurements=shuffled)))


def test_doubled_sd_does_not_raise_confidence():
    problem = exact()
    doubled = replace(problem.measurements, sd=2.0 * problem.measurements.sd)
    one, other = plain(), answer(replace(problem, measurements=doubled))
    (name,) = one.decided.named
    assert other.effects[name].probability <= one.effects[name].probability + 1e-3
    assert other.fit.p_before >= one.fit.p_before
    widths = [each.effects[name].strength.high - each.effects[name].strength.low for each in (one, other)]
    assert widths[1] > widths[0]


def test_a_null_stays_a_null_whatever_the_seed():
    assert {answer(case(*NULL).problem, seed).decided.verdict for seed in range(3)} <= set(SILENT)
