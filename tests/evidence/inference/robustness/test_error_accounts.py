"""Errors that nobody stated, in tables in which they were put."""

import re
from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.data.findings import NONE, Discovery
from taichi_erosion.evidence.data.problem import Problem
from tests.evidence.linear_study import linear_problem

SD, COUNT = 0.1, 48  # of a row, and rows
SHAPES = {"bend": lambda x: x**2, "wave": lambda x: np.sin(3.0 * x)}


def sharing(problem: Problem, tau: float, seed: int, source: bool = False) -> Problem:
    """The problem with an error of `tau` row sd that every group of rows has in common, or source B."""
    table = problem.measurements
    error = tau * SD * np.random.default_rng(seed).standard_normal(12)
    second = np.arange(table.size) % 2 == 1
    shift = tau * SD * second if source else error[np.arange(table.size) % 12]
    names = tuple("laboratory B" if other else "laboratory A" for other in second)
    return replace(
        problem,
        measurements=replace(table, value=table.value + shift, source=names if source else table.source),
    )


def with_rows_off(problem: Problem, rows: list[int], size: float) -> Problem:
    value = problem.measurements.value.copy()
    value[rows] += size * SD
    return replace(problem, measurements=replace(problem.measurements, value=value))


def with_silent_source(problem: Problem, factor: float) -> Problem:
    """The problem with every other row from laboratory B, which states no sd and scatters by more."""
    table = problem.measurements
    second = np.arange(table.size) % 2 == 1
    more = SD * factor * np.random.default_rng(2).standard_normal(table.size) * second
    names = tuple("laboratory B" if other else "laboratory A" for other in second)
    sd = np.where(second, np.nan, table.sd)
    return replace(problem, measurements=replace(table, value=table.value + more, sd=sd, source=names))


def answer(problem: Problem) -> Discovery:
    return discover(problem, 3, problem.budget, no_progress)


def test_nothing_but_noise_has_no_errors():
    problem = linear_problem(SHAPES, {}, sd=SD, count=COUNT)
    assert answer(sharing(problem, 0.0, seed=5, source=True)).errors == ()


def test_batches_are_not_taken_for_an_effect_nor_for_something_unlisted():
    problem = sharing(linear_problem(SHAPES, {}, sd=SD, count=COUNT), 3.0, seed=5)
    found = answer(problem)
    assert found.named == found.group == ()
    assert found.probabilities[NONE] > 0.5
    assert [each.kind for each in found.errors] == ["batch"]


def test_a_source_that_reads_higher_is_told_with_its_size():
    acting = {"bend": 1.0}
    problem = sharing(linear_problem(SHAPES, acting, sd=SD, count=COUNT), 5.0, 0, source=True)
    found = answer(problem)
    assert found.named == tuple(acting)
    (told,) = found.errors
    assert told.sentence.startswith("y: laboratory B reads 0.")
    low, high = (float(word) for word in told.sentence.split("(")[1].split(")")[0].split(" to "))
    assert low < 0.5 < high
    assert high - low < 0.2, "48 rows know it to 0.05"


def test_rows_that_are_off_do_not_change_the_answer():
    acting = {"bend": 1.0}
    problem = linear_problem(SHAPES, acting, sd=SD, count=COUNT)
    plain, found = answer(problem), answer(with_rows_off(problem, [17, 30], 9.0))
    assert (found.verdict, found.named) == (plain.verdict, plain.named)
    assert [each.kind for each in found.errors] == ["rows", "rows"]


def test_scatter_that_grows_along_a_condition_is_told():
    problem = linear_problem(SHAPES, {}, sd=SD, count=COUNT)
    table = problem.measurements
    noise = (table.value - 0.0) * 6.0 ** (0.5 * (table.conditions["x"] + 1.0))
    found = answer(replace(problem, measurements=replace(table, value=noise)))
    assert found.named == ()
    assert found.verdict != "outside_library"
    (told,) = found.errors
    assert "grows" in told.sentence
    assert "x" in told.sentence


@pytest.mark.parametrize("acting", [{}, {"bend": 1.0}], ids=["nothing", "bend"])
def test_the_scatter_of_a_source_that_states_none_is_found_and_told(acting):
    problem = with_silent_source(linear_problem(SHAPES, acting, sd=SD, count=COUNT), 10.0)
    found = answer(problem)
    assert found.named == tuple(acting)
    assert found.verdict != "outside_library"
    (told,) = found.errors
    factor = re.match(r"y: laboratory B states no scatter; .*, ([\d.]+) times the median", told.sentence)
    assert factor
    assert 7.0 < float(factor[1]) < 14.0, "24 rows know their sd of 10 to 15 %, the grid in octaves to 20 %"


def test_a_source_without_sd_that_scatters_as_the_others_is_told_of_nothing():
    found = answer(with_silent_source(linear_problem(SHAPES, {"bend": 1.0}, sd=SD, count=COUNT), 0.0))
    assert found.named == ("bend",)
    assert found.errors == ()
