"""Analysis of variance agrees with statsmodels' tables and with analyses printed in textbooks."""

import numpy as np
import pytest
import textbook

from taichi_erosion.experiments.anova import curvature_test, eliminate_terms
from taichi_erosion.experiments.design import central_composite, factorial_points, stack_parts
from taichi_erosion.experiments.fit import fit_model, lower_order_terms


def test_montgomerys_tool_life_has_the_printed_analysis_of_variance():
    # Montgomery (2012), solution of problem 6.1: sum of squares, F, p
    rows = textbook.rows_of(fit_model(textbook.tool_life(), "life", textbook.FULL))
    wanted = {
        "Model": (1612.67, 7.64, 0.0004), "B": (770.67, 25.55, 0.0001), "A*B*C": (28.17, 0.93, 0.3483),
    }  # fmt: skip
    for source, (sum_of_squares, f, p) in wanted.items():
        assert rows[source].sum_of_squares == textbook.printed(sum_of_squares, 2)
        assert (rows[source].f, rows[source].p) == (textbook.printed(f, 2), textbook.printed(p, 4))
    assert rows["Pure error"].mean_square == textbook.printed(30.17, 2)
    assert rows["Total"].sum_of_squares == textbook.printed(2095.33, 2)
    # the model that is left keeps A for hierarchy
    found = eliminate_terms(fit_model(textbook.tool_life(), "life", textbook.FULL))
    assert found.names == ("A", "B", "C", "A*C")
    assert found.coefficients == pytest.approx([40.83333, 0.16667, 5.66667, 3.41667, -4.41667], abs=5e-6)
    rows = textbook.rows_of(found)
    assert rows["Model"].f == textbook.printed(12.54, 2)
    assert rows["Residual"].sum_of_squares == textbook.printed(575.67, 2)
    assert rows["A*C"].p == textbook.printed(0.0009, 4)


def test_curvature_is_the_difference_of_the_means_tested_without_itself():
    parts = [("factorial", factorial_points(2, 2)), ("centre", np.zeros((5, 2)))]
    made = stack_parts("full factorial", textbook.unit_factors("ab"), parts)
    y = np.array([39.3, 40.9, 40.0, 41.5, 40.3, 40.5, 40.7, 40.2, 40.6])
    # Montgomery (2017), example 6.7: SS 0.0027, F 0.06, error 0.1720 (4)
    bend = curvature_test(fit_model(made.with_responses(y=y), "y", "interactions"))
    assert bend.difference == pytest.approx(y[:4].mean() - y[4:].mean(), rel=1e-9)
    assert (bend.sum_of_squares, bend.f) == (textbook.printed(0.0027, 4), textbook.printed(0.06, 2))
    assert bend.ms_error * bend.df_error == textbook.printed(0.1720, 4)


def test_hierarchy_is_honoured_whatever_leaves_the_model():
    made = central_composite(textbook.unit_factors("abcd"))
    for seed in range(5):
        y = np.random.default_rng(seed).normal(size=len(made)) + 5.0 * made.coded[:, 0] * made.coded[:, 1]
        found = eliminate_terms(fit_model(made.with_responses(y=y), "y", "quadratic"))
        assert (1, 1, 0, 0) in found.terms
        assert all(lower_order_terms(term) <= set(found.terms) for term in found.terms)
