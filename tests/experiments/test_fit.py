"""Fitted models, their quality and residuals agree with statsmodels and with printed analyses."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import textbook
from hypothesis import given
from hypothesis import strategies as st
from statsmodels.formula.api import ols
from statsmodels.stats.anova import anova_lm

from taichi_erosion.experiments import design
from taichi_erosion.experiments import fit as fits
from taichi_erosion.experiments.design import Factor


def test_johns_odour_has_the_analysis_that_sas_prints():
    # SAS/STAT user's guide, the RSREG procedure, "A response surface with a simple optimum"
    fit = fits.fit_model(textbook.smell(), "odour", "quadratic")
    rows, merit = textbook.rows_of(fit), fits.figures_of_merit(fit)
    assert (merit.mean, merit.sd) == (textbook.printed(15.2, 6), textbook.printed(22.478508, 6))
    assert (merit.r2, merit.cv) == (textbook.printed(0.8820, 4), textbook.printed(147.8849, 4))
    assert (rows["Model"].f, rows["Model"].p) == (textbook.printed(4.15, 2), textbook.printed(0.0657, 4))
    assert rows["Lack of fit"].f == textbook.printed(40.75, 2)
    assert rows["Lack of fit"].p == textbook.printed(0.0240, 4)
    assert rows["Residual"].mean_square == textbook.printed(505.283333, 6)


@pytest.mark.parametrize("seed", range(5))
def test_any_quadratic_fit_agrees_with_the_type_iii_table_of_statsmodels(seed):
    rng = np.random.default_rng(seed)
    made = design.central_composite(textbook.unit_factors("abc"))
    made = replace(made, coded=made.coded + rng.normal(0.0, 0.1, made.coded.shape))  # far from orthogonal
    y = rng.normal(size=len(made)) + made.coded @ [1.0, -2.0, 0.3]
    fit = fits.fit_model(made.with_responses(y=y), "y", "quadratic")
    frame = pd.DataFrame(made.coded, columns=["a", "b", "c"]).assign(y=y)
    theirs = ols("y ~ a + b + c + a:b + a:c + b:c + I(a**2) + I(b**2) + I(c**2)", frame).fit()
    table = anova_lm(theirs, typ=3)
    for name, row in zip(fit.names, table.index[1:-1], strict=True):
        ours = textbook.rows_of(fit)[name]
        assert ours.sum_of_squares == pytest.approx(table.loc[row, "sum_sq"], rel=1e-9)
        assert ours.f == pytest.approx(table.loc[row, "F"], rel=1e-9)
        assert ours.p == pytest.approx(table.loc[row, "PR(>F)"], rel=1e-8)
    assert fits.figures_of_merit(fit).r2_adjusted == pytest.approx(theirs.rsquared_adj, rel=1e-12)
    assert fits.coefficient_table(fit)["p"].tolist() == pytest.approx(theirs.pvalues.tolist(), rel=1e-8)


def test_press_is_what_leaving_each_run_out_gives():
    fit = fits.fit_model(textbook.smell(), "odour", "quadratic")
    total = 0.0
    for row in range(len(fit.values)):
        rest = np.arange(len(fit.values)) != row
        matrix = fits.model_matrix(fit.coded, fit.terms)
        without = np.linalg.lstsq(matrix[rest], fit.values[rest], rcond=None)[0]
        total += (fit.values[row] - matrix[row] @ without) ** 2
    assert fits.figures_of_merit(fit).press == pytest.approx(total, rel=1e-10)


@given(st.lists(st.floats(-5.0, 5.0), min_size=10, max_size=10), st.floats(0.1, 10.0), st.floats(-3.0, 3.0))
def test_natural_and_coded_equation_have_one_value(values, half, centre):
    ranges = [("a", centre - half, centre + half), ("b", 1.0, 2.0), ("c", -9.0, 9.0)]
    made = design.box_behnken([Factor(*entry) for entry in ranges])
    matrix = fits.model_matrix(made.coded, fits.model_terms(3, "quadratic"))
    fit = fits.fit_model(made.with_responses(y=matrix @ values), "y", "quadratic")
    for coded, place in zip(made.coded, made.natural, strict=True):
        wanted, found = (
            sum(factor * np.prod(at ** np.array(term)) for term, factor in polynomial.items())
            for polynomial, at in ((fits.coded_polynomial(fit), coded), (fits.natural_polynomial(fit), place))
        )
        # centre over half range is 30 at most: its square costs three of sixteen digits
        assert found == pytest.approx(wanted, abs=1e-9)


def test_failed_runs_are_left_out_and_the_rest_is_fitted():
    made = textbook.tool_life()
    values = made.responses["life"].copy()
    values[0] = np.nan
    fit = fits.fit_model(made.with_responses(life=values), "life", textbook.FULL)
    assert (fit.rows.tolist(), fit.df_error) == (list(range(1, 24)), 15)
