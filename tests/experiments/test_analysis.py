"""The analysis agrees with statsmodels' own tables and with analyses printed in textbooks."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from statsmodels.formula.api import ols
from statsmodels.stats.anova import anova_lm
from statsmodels.stats.outliers_influence import OLSInfluence, variance_inflation_factor
from textbook import chemical_yield, smell, tool_life, unit_factors

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments import design
from taichi_erosion.experiments.anova import (
    PureError,
    Row,
    anova,
    curvature,
    effect_limits,
    effects,
    half_normal_scores,
    lenth_limits,
    reduced,
    replicate_error,
    seed_error,
)
from taichi_erosion.experiments.fit import (
    Fit,
    coded_polynomial,
    coefficient_table,
    equation,
    evaluate,
    fit_model,
    natural_polynomial,
)
from taichi_erosion.experiments.quality import diagnostics, quality
from taichi_erosion.experiments.terms import model_matrix, model_terms, parents, parse_term, term_name

FULL = (*model_terms(3, "interactions"), (1, 1, 1))


def rows_of(fit: Fit, **words) -> dict[str, Row]:
    return {row.source: row for row in anova(fit, **words)}


def printed(value: float, digits: int) -> object:
    """What agrees with a number printed with so many decimals."""
    return pytest.approx(value, abs=0.5000001 * 10.0**-digits)


def test_montgomerys_tool_life_has_the_printed_analysis_of_variance():
    # Montgomery (2012), solution of problem 6.1: sum of squares, F, p
    rows = rows_of(fit_model(tool_life(), "life", FULL))
    wanted = {
        "Model": (1612.67, 7.64, 0.0004), "B": (770.67, 25.55, 0.0001), "C": (280.17, 9.29, 0.0077),
        "A*B": (16.67, 0.55, 0.4681), "A*C": (468.17, 15.52, 0.0012), "B*C": (48.17, 1.60, 0.2245),
        "A*B*C": (28.17, 0.93, 0.3483),
    }  # fmt: skip
    for source, (sum_of_squares, f, p) in wanted.items():
        assert rows[source].sum_of_squares == printed(sum_of_squares, 2)
        assert rows[source].f == printed(f, 2)
        assert rows[source].p == printed(p, 4)
    assert rows["Pure error"].mean_square == printed(30.17, 2)
    assert rows["Total"].sum_of_squares == printed(2095.33, 2)


def test_montgomerys_tool_life_reduces_to_the_printed_model_with_a_kept_for_hierarchy():
    found = reduced(fit_model(tool_life(), "life", FULL))
    assert found.fit.names == ("A", "B", "C", "A*C")
    assert [name for name, _ in found.removed] == ["A*B*C", "A*B", "B*C"]
    assert found.fit.coefficients == pytest.approx([40.83333, 0.16667, 5.66667, 3.41667, -4.41667], abs=5e-6)
    rows = rows_of(found.fit)
    assert rows["Model"].f == printed(12.54, 2)
    assert rows["Residual"].sum_of_squares == printed(575.67, 2)
    assert rows["A*C"].p == printed(0.0009, 4)


def test_myers_and_montgomerys_conversion_has_the_printed_lack_of_fit():
    # Myers & Montgomery (1995), table 2.8: residual 35.35 (6), pure error 26.75 (3), lack of fit 8.6 (3)
    rows = rows_of(fit_model(chemical_yield(), "conversion", "quadratic"))
    assert (rows["Residual"].df, rows["Pure error"].df, rows["Lack of fit"].df) == (6, 3, 3)
    assert rows["Residual"].sum_of_squares == printed(35.35, 2)
    assert rows["Pure error"].sum_of_squares == printed(26.75, 2)
    assert rows["Lack of fit"].sum_of_squares == printed(8.6, 1)


def test_johns_odour_has_the_analysis_that_sas_prints():
    # SAS/STAT user's guide, the RSREG procedure, "A response surface with a simple optimum"
    fit = fit_model(smell(), "odour", "quadratic")
    rows, merit = rows_of(fit), quality(fit)
    assert (merit.mean, merit.sd) == (printed(15.2, 6), printed(22.478508, 6))
    assert (merit.r2, merit.cv) == (printed(0.8820, 4), printed(147.8849, 4))
    assert (rows["Model"].f, rows["Model"].p) == (printed(4.15, 2), printed(0.0657, 4))
    assert (rows["Lack of fit"].f, rows["Lack of fit"].p) == (printed(40.75, 2), printed(0.0240, 4))
    assert rows["Residual"].mean_square == printed(505.283333, 6)
    coded = {name: line.value for name, line in zip(("1", *fit.names), coefficient_table(fit), strict=True)}
    assert coded["1"] == printed(-30.666667, 6)
    assert coded["R^2"] == printed(47.833333, 6)


@pytest.mark.parametrize("seed", range(5))
def test_any_quadratic_fit_agrees_with_the_type_iii_table_of_statsmodels(seed):
    rng = np.random.default_rng(seed)
    made = design.central_composite(unit_factors("abc"))
    made = replace(made, coded=made.coded + rng.normal(0.0, 0.1, made.coded.shape))  # far from orthogonal
    y = rng.normal(size=len(made)) + made.coded @ [1.0, -2.0, 0.3]
    fit = fit_model(made.with_responses(y=y), "y", "quadratic")
    frame = pd.DataFrame(made.coded, columns=["a", "b", "c"]).assign(y=y)
    formula = "y ~ a + b + c + a:b + a:c + b:c + I(a**2) + I(b**2) + I(c**2)"
    theirs = ols(formula, frame).fit()
    table = anova_lm(theirs, typ=3)
    for name, row in zip(fit.names, table.index[1:-1], strict=True):
        ours = rows_of(fit)[name]
        assert ours.sum_of_squares == pytest.approx(table.loc[row, "sum_sq"], rel=1e-9)
        assert ours.f == pytest.approx(table.loc[row, "F"], rel=1e-9)
        assert ours.p == pytest.approx(table.loc[row, "PR(>F)"], rel=1e-8)
    assert quality(fit).r2_adjusted == pytest.approx(theirs.rsquared_adj, rel=1e-12)
    assert [line.p for line in coefficient_table(fit)] == pytest.approx(theirs.pvalues.tolist(), rel=1e-8)


def test_inflation_factors_press_and_residuals_agree_with_statsmodels():
    fit = fit_model(smell(), "odour", "quadratic")
    matrix = model_matrix(fit.coded, fit.terms)
    theirs = [variance_inflation_factor(matrix, k) for k in range(1, matrix.shape[1])]
    assert [line.vif for line in coefficient_table(fit)[1:]] == pytest.approx(theirs, rel=1e-9)
    influence = OLSInfluence(fit.results)
    found = diagnostics(fit)
    assert quality(fit).press == pytest.approx(float(np.sum(influence.resid_press**2)), rel=1e-9)
    assert found.studentized == pytest.approx(influence.resid_studentized_internal, rel=1e-9)
    assert found.deleted == pytest.approx(influence.resid_studentized_external, rel=1e-9)
    assert found.cook == pytest.approx(influence.cooks_distance[0], rel=1e-9)


def test_press_is_what_leaving_each_run_out_gives():
    fit = fit_model(chemical_yield(), "conversion", "quadratic")
    total = 0.0
    for row in range(len(fit.values)):
        rest = np.arange(len(fit.values)) != row
        matrix = model_matrix(fit.coded, fit.terms)
        without = np.linalg.lstsq(matrix[rest], fit.values[rest], rcond=None)[0]
        total += (fit.values[row] - matrix[row] @ without) ** 2
    assert quality(fit).press == pytest.approx(total, rel=1e-10)


def test_a_wild_run_is_named_by_its_row():
    made = chemical_yield()
    values = made.responses["conversion"].copy()
    values[9] += 40.0
    found = diagnostics(fit_model(made.with_responses(conversion=values), "conversion", "quadratic"))
    assert found.outliers == (9,)


def test_blocks_take_their_difference_out_of_the_effects():
    rng = np.random.default_rng(2)
    made = design.plackett_burman(unit_factors("abcdefg"), centre_points=2, fold_over=True)
    plain = made.coded @ np.arange(7.0) + rng.normal(0.0, 0.1, len(made))
    shifted = plain + 100.0 * (made.blocks == 2)
    fits = [fit_model(made.with_responses(y=y), "y", "linear") for y in (plain, shifted)]
    assert fits[1].coefficients[1:] == pytest.approx(fits[0].coefficients[1:], abs=1e-9)
    assert fits[1].ss_error == pytest.approx(fits[0].ss_error, rel=1e-6)
    # half of the difference of blocks goes to the constant, which belongs to the average block
    assert fits[1].coefficients[0] - fits[0].coefficients[0] == pytest.approx(50.0, abs=1e-9)
    rows = rows_of(fits[1])
    parts = sum(rows[name].sum_of_squares for name in ("Block", "Model", "Residual"))
    assert parts == pytest.approx(rows["Total"].sum_of_squares, rel=1e-12)


def test_curvature_is_the_difference_of_the_means_tested_without_itself():
    made = design.full_factorial(unit_factors("ab"), centre_points=5)
    y = np.array([39.3, 40.9, 40.0, 41.5, 40.3, 40.5, 40.7, 40.2, 40.6])
    # Montgomery (2017), example 6.7: SS 0.0027, F 0.06, error 0.1720 (4)
    bend = curvature(fit_model(made.with_responses(y=y), "y", "interactions"))
    assert bend is not None
    assert bend.difference == pytest.approx(y[:4].mean() - y[4:].mean(), rel=1e-9)
    assert bend.sum_of_squares == printed(0.0027, 4)
    assert bend.f == printed(0.06, 2)
    assert bend.ms_error * bend.df_error == printed(0.1720, 4)


def test_a_design_without_centre_says_nothing_about_curvature():
    assert curvature(fit_model(tool_life(), "life", FULL)) is None


def test_a_seed_error_is_the_variance_of_a_mean_of_seeds():
    rng = np.random.default_rng(0)
    seeds = rng.normal(10.0, 2.0, size=(400, 4))
    found = seed_error(seeds.std(axis=1, ddof=1), np.full(400, 4))
    assert found.df == 1200
    # 1200 degrees of freedom know a variance of 4 / 4 to sqrt(2 / 1200) = 4 %; three times that is allowed
    assert found.mean_square == pytest.approx(1.0, rel=0.12)


def test_the_noise_of_seeds_reveals_a_lack_of_fit_that_the_runs_alone_cannot_show():
    made = design.full_factorial(unit_factors("ab"), levels=3)
    y = 3.0 * made.coded[:, 0] ** 2
    fit = fit_model(made.with_responses(y=y), "y", "linear")
    assert "Lack of fit" not in rows_of(fit)
    quiet = rows_of(fit, seeds=PureError(0.01 * 18, 18))
    loud = rows_of(fit, seeds=PureError(25.0 * 18, 18))
    assert quiet["Lack of fit"].p < 1e-6
    assert loud["Lack of fit"].p > 0.5


def test_terms_can_be_tested_against_the_pure_error():
    fit = fit_model(smell(), "odour", "quadratic")
    row = rows_of(fit, error="pure error")["T"]
    pure = replicate_error(fit)
    assert row.f == pytest.approx(row.sum_of_squares / pure.mean_square)
    assert row.p == pytest.approx(float(stats.f.sf(row.f, 1, pure.df)))


def test_equal_replicates_give_an_infinite_f_and_no_division_by_zero():
    made = design.full_factorial(unit_factors("a"), levels=3, centre_points=2)
    fit = fit_model(made.with_responses(y=[0.0, 1.0, 0.0, 1.0, 1.0]), "y", "linear")
    assert rows_of(fit)["Lack of fit"].f == np.inf


def test_hierarchy_is_honoured_whatever_leaves_the_model():
    made = design.central_composite(unit_factors("abcd"))
    for seed in range(5):
        y = np.random.default_rng(seed).normal(size=len(made)) + 5.0 * made.coded[:, 0] * made.coded[:, 1]
        found = reduced(fit_model(made.with_responses(y=y), "y", "quadratic")).fit
        assert (1, 1, 0, 0) in found.terms
        assert all(parents(term) <= set(found.terms) for term in found.terms)


@given(st.lists(st.floats(-5.0, 5.0), min_size=10, max_size=10), st.floats(0.1, 10.0), st.floats(-3.0, 3.0))
def test_natural_and_coded_equation_have_one_value(values, half, centre):
    ranges = [("a", centre - half, centre + half), ("b", 1.0, 2.0), ("c", -9.0, 9.0)]
    made = design.box_behnken([design.Factor(*entry) for entry in ranges])
    matrix = model_matrix(made.coded, model_terms(3, "quadratic"))
    fit = fit_model(made.with_responses(y=matrix @ values), "y", "quadratic")
    natural = natural_polynomial(fit)
    for coded, place in zip(made.coded, made.natural, strict=True):
        wanted = evaluate(coded_polynomial(fit), tuple(coded))
        # centre over half range is 30 at most: its square costs three of sixteen digits
        assert evaluate(natural, tuple(place)) == pytest.approx(wanted, abs=1e-9)


def test_an_equation_reads_like_one():
    fit = fit_model(tool_life(), "life", [(1, 0, 0), (0, 0, 1), (1, 0, 1)])
    assert equation(fit, coded_polynomial(fit), 3) == "life = 40.8 + 0.167 A + 3.42 C - 4.42 A*C"


def test_effects_are_differences_of_means():
    made = tool_life()
    found = effects(fit_model(made, "life", FULL))
    y, a = made.responses["life"], made.coded[:, 0]
    assert found[0].value == pytest.approx(y[a > 0].mean() - y[a < 0].mean(), rel=1e-9)
    assert sum(effect.share for effect in found) == pytest.approx(1.0, rel=1e-12)


def test_an_effect_at_its_limit_has_a_p_value_of_five_percent():
    fit = fit_model(tool_life(), "life", FULL)
    limit = effect_limits(fit)
    effect = effects(fit)[0]
    t = limit.single / (effect.value / effect.t)
    assert 2.0 * stats.t.sf(t, fit.df_error) == pytest.approx(0.05, rel=1e-9)
    assert limit.bonferroni > limit.single


def test_lenths_limits_are_those_worked_out_by_hand():
    values = [0.13, 0.15, 0.30, 0.15, 0.40, 0.03, 0.38, 0.40, 0.05, 0.43, 0.13, 0.13, 0.38, 2.15, 3.10]
    margin, together = lenth_limits(np.array(values))
    # median 0.30, s0 = 0.45, 2.5 s0 = 1.125 trims 2.15 and 3.10; median of the other 13 is 0.15, PSE 0.225
    assert margin == pytest.approx(2.5706 * 0.225, rel=1e-4)  # t(0.975, 5) of any table
    share = 0.5 * (1.0 + 0.95 ** (1.0 / 15.0))
    assert together == pytest.approx(float(stats.t.ppf(share, 5.0)) * 0.225, rel=1e-9)


def test_half_normal_scores_of_noise_lie_on_a_line():
    sizes = np.sort(np.abs(np.random.default_rng(3).normal(size=2000)))
    # the largest of 2000 scatters most; without the last percent the order statistics are within 0.1
    assert np.max(np.abs(sizes - half_normal_scores(2000))[:1980]) < 0.1


def test_failed_runs_are_left_out_and_the_rest_is_fitted():
    made = tool_life()
    values = made.responses["life"].copy()
    values[0] = np.nan
    fit = fit_model(made.with_responses(life=values), "life", FULL)
    assert fit.rows.tolist() == list(range(1, 24))
    assert fit.df_error == 15


@pytest.mark.parametrize(
    ("response", "terms", "words"),
    [("colour", "linear", "no response 'colour'"), ("life", "quadratic", "tell .* apart")],
)
def test_a_model_that_the_runs_cannot_carry_is_refused(response, terms, words):
    with pytest.raises(BadInput, match=words):
        fit_model(tool_life(), response, terms)


@pytest.mark.parametrize("text", ["A*C", "AC", "CA", "A C"])
def test_an_interaction_is_read_however_it_is_printed(text):
    assert parse_term(text, ["A", "B", "C"]) == (1, 0, 1)


@pytest.mark.parametrize("text", ["B^2", "B2", "B\u00b2"])
def test_a_square_is_read_however_it_is_printed(text):
    assert term_name(parse_term(text, ["A", "B", "C"]), ["A", "B", "C"]) == "B^2"
