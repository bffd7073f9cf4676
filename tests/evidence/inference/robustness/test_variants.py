"""What an answer hangs on: cheap variants against the whole analysis made anew."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.data.problem import Observable, Problem
from taichi_erosion.evidence.inference.pipeline import account, analyse
from taichi_erosion.evidence.inference.prepared_problem import prepare
from taichi_erosion.evidence.inference.robustness.variants import (
    all_variants,
    averaged_variants,
    row_sets,
    variants,
    with_prior_scales,
    without_rows,
)
from tests.evidence.inference.robustness.test_error_accounts import COUNT, SD, sharing
from tests.evidence.linear_study import linear_problem

SHAPES = {"bend": lambda x: x**2, "wave": lambda x: np.sin(3.0 * x)}


def weak(strength: float = 0.22, tolerance: float = 0.0) -> Problem:
    problem = linear_problem(SHAPES, {"bend": strength}, sd=0.1, count=36)
    return replace(problem, observables={"y": Observable("y", sd_numerical=tolerance)})


def test_a_row_left_out_gives_the_probabilities_of_the_table_without_it():
    problem = weak()
    prepared = prepare(problem, problem.measurements, 1)
    whole = account(prepared, 1, no_progress)
    rows = np.arange(36) == 35
    cheap = without_rows(whole.fitted, rows)
    shorter = replace(problem, measurements=problem.measurements.rows(~rows))
    anew = account(prepare(shorter, shorter.measurements, 1), 1, no_progress)
    one, other = cheap.posterior.probability, anew.posterior.probability
    assert abs(whole.posterior.probability["bend"] - other["bend"]) > 0.01, "the row matters"
    assert one["bend"] == pytest.approx(other["bend"], abs=0.02)
    assert one["none"] == pytest.approx(other["none"], abs=0.02)


def test_wider_priors_give_the_probabilities_of_the_study_that_states_them():
    problem = weak()
    whole = account(prepare(problem, problem.measurements, 1), 1, no_progress)
    wide = replace(
        problem, candidates=tuple(replace(c, prior_scale=2.0 * c.prior_scale) for c in problem.candidates)
    )
    anew = account(prepare(wide, wide.measurements, 1), 1, no_progress)
    one = with_prior_scales(whole.fitted, 2.0).posterior.probability
    assert one["bend"] == pytest.approx(anew.posterior.probability["bend"], abs=0.02)


def test_an_answer_says_the_tolerance_that_it_hangs_on():
    problem = weak(0.24, 0.1)
    found = analyse(prepare(problem, problem.measurements, 1), 1, no_progress)
    assert (found.decision.verdict, found.decision.named) == ("present", ("bend",))
    told = variants(found)
    assert told.holds == told.count - 1
    assert told.changes == ("nothing missing (50 %) if the tolerance of 0.1 of y is 2 times as large",)


def test_a_clear_answer_holds_everywhere_and_says_so():
    problem = weak(2.0)
    found = discover(problem, 1, problem.budget, no_progress)
    assert found.variants.holds == found.variants.count > 10
    assert f"The answer holds in all {found.variants.count} variants" in " ".join(found.sentences)


def test_silence_has_no_variants():
    problem = linear_problem(SHAPES, {}, count=36)
    assert discover(problem, 1, problem.budget, no_progress).variants.count == 0


def test_a_shared_error_that_is_not_granted_gives_the_answer_of_the_study_that_declares_none():
    problem = linear_problem(SHAPES, {"wave": 1.0}, sd=0.1, count=36, calibrated=False)
    table = replace(problem.measurements, value=problem.measurements.value + 1.5)
    problem = replace(problem, measurements=table)
    declared = replace(problem, observables={"y": Observable("y", sd_shared=1.0)})
    found = analyse(prepare(declared, table, 1), 1, no_progress)
    bare = analyse(prepare(problem, table, 1), 1, no_progress)
    assert found.decision.named == bare.decision.named == ("wave",)
    assert bare.level_probability > 0.9
    told = variants(found)
    assert not any("is not granted" in words for words in told.changes), told.changes


def test_a_group_left_out_of_an_averaged_answer_gives_the_average_of_the_table_without_it():
    problem = sharing(linear_problem(SHAPES, {"bend": 0.25}, sd=SD, count=COUNT), 1.0, seed=5)
    found = analyse(prepare(problem, problem.measurements, 1), 1, no_progress)
    assert 0.1 < found.errors_probability < 0.9, "errors of groups and errors as stated both count"
    words, left = "without group g1", np.array(problem.measurements.group) != "g1"
    averaged = dict(averaged_variants(found))[words].inclusion["bend"]
    lead, sets = found.fitted, list(row_sets(found.fitted))
    one = {each.words: each for each in all_variants(lead, sets)}[words]
    shorter = problem.measurements.rows(left)
    anew = analyse(prepare(replace(problem, measurements=shorter), shorter, 1), 1, no_progress)
    wanted = anew.posterior.inclusion["bend"]
    assert averaged == pytest.approx(wanted, abs=0.005)
    assert abs(one.posterior().inclusion["bend"] - wanted) > 0.015, "one account alone gives another answer"


def test_rows_that_name_no_source_are_of_one_their_file():
    problem = weak()
    placed = replace(problem.measurements, source=tuple(f"lab, row {k}" for k in range(36)))
    found = analyse(prepare(replace(problem, measurements=placed), placed, 1), 1, no_progress)
    words = [each for each, _ in row_sets(found.fitted)]
    assert words
    assert not [each for each in words if "source" in each], (
        "a table of one source is not left out row by row"
    )
    mixed = replace(placed, source=("Smith 1999",) * 12 + placed.source[12:])
    found = analyse(prepare(replace(problem, measurements=mixed), mixed, 1), 1, no_progress)
    sets = dict(row_sets(found.fitted))
    assert sets["without source lab"].sum() == 24
    assert sets["without source Smith 1999"].sum() == 12


def test_a_group_that_has_no_name_is_left_out_by_its_conditions_in_the_units_of_the_table():
    problem = weak()
    table = problem.measurements
    (name,) = table.conditions
    unnamed = replace(table, group=tuple(f"{value:g}" for value in table.conditions[name]))
    found = analyse(prepare(replace(problem, measurements=unnamed), unnamed, 1), 1, no_progress)
    words = [each for each, _ in row_sets(found.fitted) if each.startswith("without the rows at ")]
    assert words
    assert all(f"{name} = " in each for each in words)
