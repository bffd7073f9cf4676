"""The law and the exponent of a misfit that no candidate describes, read from exact residuals."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.evidence.inference.marginal_likelihood import projected_residual
from taichi_erosion.evidence.inference.residual_structure import best_law, scaling
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
