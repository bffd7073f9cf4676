"""The law and the exponent of a misfit that no candidate describes, read from exact residuals."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.evidence.inference.goodness_of_fit import misfit_places
from taichi_erosion.evidence.inference.marginal_likelihood import projected_residual
from taichi_erosion.evidence.inference.residual_structure import (
    best_law,
    extremum,
    residual_trends,
    scaling,
    varying_number,
)
from tests.evidence.linear_study import linear_problem, screened

HIDDEN = {"bend": lambda x: x**2}
ALL = np.ones(24, dtype=bool)


@pytest.fixture(scope="module")
def study():
    problem = linear_problem({**HIDDEN, "wave": lambda x: np.sin(9.0 * x)}, {"bend": 1.0})
    return screened(replace(problem, candidates=problem.candidates[1:]))


def test_a_hidden_square_is_found_as_a_law_of_its_power(study):
    prepared, found = study
    law = best_law(prepared, projected_residual(prepared, found.base), ALL, "y")
    assert law is not None
    assert law.terms[0] == {"x": 2.0}
    assert law.held_out_share > 0.8
    typical = float(np.median(np.abs(prepared.rows.conditions["x"])))
    assert law.coefficients[0] / typical**2 == pytest.approx(1.0, abs=0.2)


def test_the_trend_of_a_failing_observable_is_told_with_its_law(study):
    prepared, found = study
    (trend,) = residual_trends(prepared, found.base, misfit_places(prepared, found.base))
    assert (trend.observable, trend.axis, trend.sign) == ("y", "x", 1)
    assert np.isnan(trend.exponent), "the condition changes sign"
    assert "hypothesis: change of y = " in trend.sentence


@pytest.mark.parametrize("power", [-1.5, 0.5, 2.0])
def test_the_exponent_of_a_power_law_lies_in_its_interval(study, power):
    prepared, found = study
    positive = prepared.rows.conditions["x"] + 1.5
    rows = replace(prepared.rows, conditions={"x": positive})
    left = projected_residual(prepared, found.base)
    law = left.project(3.0 * (positive**power - np.mean(positive**power)) / prepared.sd)
    exact = replace(left, stacked=np.append(law, left.stacked[24:]))
    best, low, high = scaling(replace(prepared, rows=rows), exact, ALL, positive)
    assert low <= best <= high
    assert best == pytest.approx(power, abs=0.051), "profiled in steps of 0.05"


def test_an_exponent_that_lies_beyond_those_tried_is_not_told(study):
    prepared, found = study
    positive = prepared.rows.conditions["x"] + 1.5
    rows = replace(prepared.rows, conditions={"x": positive})
    left = projected_residual(prepared, found.base)
    law = left.project(0.01 * positive**6.0 / prepared.sd)
    exact = replace(left, stacked=np.append(law, left.stacked[24:]))
    assert np.all(np.isnan(scaling(replace(prepared, rows=rows), exact, ALL, positive)))


def test_an_extremum_is_found_where_it_is_and_nowhere_on_a_slope():
    column = np.repeat([0.5, 1.0, 2.0, 4.0, 8.0], 5)
    bump = 4.0 * np.exp(-(np.log(column / 2.0) ** 2))
    assert extremum(column, bump) == ("has a bump at", 2.0)
    assert extremum(column, -bump) == ("has a dip at", 2.0)
    assert extremum(column, np.log(column)) is None


def test_the_number_that_would_have_to_vary_is_named_with_its_condition():
    """A level that grows with x is what a slope along x would be."""
    problem = linear_problem({"slope": lambda x: x, "wave": lambda x: np.sin(9.0 * x)}, {"slope": 1.0})
    prepared, found = screened(replace(problem, candidates=problem.candidates[1:]))
    told = varying_number(prepared, found.base)
    assert told is not None
    assert (told.parameter, told.condition) == ("level", "x")
    assert told.share > 0.9
    assert told.sentence.endswith("of the misfit would go if level rose with x.")
