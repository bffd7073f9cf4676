"""Optima, unreachable targets and confirmation runs, against answers known beforehand."""

from math import inf, nan

import numpy as np
import pytest
from scipy import stats
from statsmodels.stats.power import TTestIndPower, TTestPower
from textbook import unit_factors

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.confirm import Sample, confirm, detectable, power
from taichi_erosion.experiments.design import Factor, box_behnken, central_composite
from taichi_erosion.experiments.fit import Fit, fit_model
from taichi_erosion.experiments.optimise import SEPARATE, Goal, completed, desirability, optimise

RANGES = [Factor("a", 0.0, 2.0), Factor("b", 10.0, 30.0)]


def surface(response: str, law) -> Fit:
    """Exact quadratic of two coded factors, with a little noise so that intervals exist."""
    made = central_composite(RANGES, axial="faced")
    noise = 1e-6 * np.random.default_rng(1).normal(size=len(made))
    return fit_model(made.with_responses(**{response: law(*made.coded.T) + noise}), response, "quadratic")


def hill(a, b):
    return 10.0 - 4.0 * (a - 0.5) ** 2 - 2.0 * (b + 0.25) ** 2


def test_the_top_of_a_hill_is_found_in_natural_units():
    found = optimise([surface("y", hill)], [Goal("y", "maximise")])
    assert found.optima[0].settings == pytest.approx({"a": 1.5, "b": 17.5}, abs=1e-4)
    assert found.optima[0].predictions["y"].value == pytest.approx(10.0, abs=1e-4)
    assert found.optima[0].desirability == pytest.approx(1.0, abs=1e-4)
    assert found.sentences == ()


def test_a_minimum_on_a_corner_is_found_there():
    found = optimise([surface("y", hill)], [Goal("y", "minimise")])
    assert found.optima[0].settings == pytest.approx({"a": 0.0, "b": 30.0}, abs=1e-9)


def test_a_saddle_has_two_equal_optima_and_both_are_listed():
    found = optimise([surface("y", lambda a, b: a * b)], [Goal("y", "maximise")])
    best = [o for o in found.optima if o.desirability > found.optima[0].desirability - 1e-4]
    assert sorted(tuple(np.round(o.coded, 6)) for o in best) == [(-1.0, -1.0), (1.0, 1.0)]


def test_a_target_that_is_reached_is_met_along_a_line_of_separate_points():
    found = optimise([surface("y", hill)], [Goal("y", "target", 8.0)])
    assert found.met
    assert any("line or face" in sentence for sentence in found.sentences)
    best = [o for o in found.optima if o.desirability > 1.0 - 1e-6]
    assert len(best) > 3
    for k, one in enumerate(best):
        assert one.predictions["y"].value == pytest.approx(8.0, abs=1e-4)
        assert all(np.max(np.abs(one.coded - other.coded)) > SEPARATE for other in best[:k])


def test_the_most_certain_of_equal_points_comes_first():
    fit = surface("y", hill)
    best = [o for o in optimise([fit], [Goal("y", "target", 8.0)]).optima if o.desirability > 1.0 - 1e-6]
    spreads = [float(fit.leverage(o.coded[None, :])[0]) for o in best]
    assert spreads[0] == min(spreads)


def test_a_target_above_the_surface_is_said_to_be_out_of_reach_with_the_nearest_value():
    found = optimise([surface("y", hill)], [Goal("y", "target", 12.0)])
    assert not found.met
    (sentence,) = found.sentences
    assert "the target 12 lies outside what this model reaches" in sentence
    assert "the nearest is 10 at a = 1.5, b = 17.5" in sentence
    assert found.optima[0].predictions["y"].value == pytest.approx(10.0, abs=1e-4)


def test_the_reach_of_a_surface_is_that_of_a_fine_grid():
    fit = surface("y", hill)
    ticks = np.linspace(-1.0, 1.0, 201)
    grid = fit.predict(np.array([(a, b) for a in ticks for b in ticks]))
    reach = optimise([fit], [Goal("y", "maximise")]).reach["y"]
    # the grid misses a quadratic's top by 4 (0.005)^2
    assert reach.high == pytest.approx(grid.max(), abs=1e-3)
    assert reach.low == pytest.approx(grid.min(), abs=1e-9)


def test_two_wishes_that_exclude_each_other_are_called_so():
    fits = [surface("y", lambda a, b: a), surface("z", lambda a, b: -a)]
    found = optimise(fits, [Goal("y", "target", 0.5), Goal("z", "target", 0.5)])
    assert not found.met
    assert "not all of them at one point" in found.sentences[0]
    assert found.optima[0].coded[0] == pytest.approx(0.0, abs=1e-3)


def test_two_wishes_that_agree_are_both_met():
    fits = [surface("y", lambda a, b: a + b), surface("z", lambda a, b: a - b)]
    found = optimise(fits, [Goal("y", "target", 0.5), Goal("z", "target", 0.1)])
    assert found.met
    assert found.optima[0].coded == pytest.approx([0.3, 0.2], abs=1e-4)


def test_desirability_is_that_of_derringer_and_suich():
    goals = [Goal("y", "maximise", low=0.0, high=10.0, weight=2.0), Goal("z", "target", 5.0, 0.0, 10.0)]
    worth = desirability(goals, np.array([[5.0, 2.5], [11.0, 5.0], [-1.0, 5.0]]))
    # 0.5^2 and 0.5, geometric mean; both met; the first below its limit
    assert worth == pytest.approx([np.sqrt(0.25 * 0.5), 1.0, 0.0], rel=1e-12)


def test_importance_is_an_exponent():
    goals = [
        Goal("y", "minimise", low=0.0, high=1.0, importance=3.0),
        Goal("z", "minimise", low=0.0, high=1.0),
    ]
    assert desirability(goals, np.array([[0.4, 0.9]]))[0] == pytest.approx((0.6**3 * 0.1) ** 0.25, rel=1e-12)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Goal("y", "target"), "a target is stated"),
        (lambda: Goal("y", "maximise", 3.0), "a target is stated"),
        (lambda: Goal("y", "maximise", weight=0.0), "above 0"),
        (lambda: completed(Goal("y", "target", 5.0, 6.0, 7.0), 0.0, 9.0), "target between"),
        (lambda: optimise([surface("y", hill)], [Goal("z", "maximise")]), "no such response"),
        (lambda: optimise([surface("y", hill)], []), "no goal"),
    ],
)
def test_wishes_that_make_no_sense_are_refused(make, words):
    with pytest.raises(BadInput, match=words):
        make()


def test_welch_and_student_agree_with_scipy():
    values = [33.02, 32.52, 33.18]
    wanted = Sample(33.52, 0.68, 10)
    for pooled in (False, True):
        theirs = stats.ttest_ind_from_stats(
            np.mean(values), np.std(values, ddof=1), 3, 33.52, 0.68, 10, equal_var=pooled
        )
        found = confirm(values, wanted, pooled=pooled)
        assert (found.t, found.p) == pytest.approx((theirs.statistic, theirs.pvalue), rel=1e-12)


def test_a_bare_number_is_tested_with_one_sample():
    values = [1.0, 2.0, 4.0, 3.5]
    found = confirm(values, 2.0)
    theirs = stats.ttest_1samp(values, 2.0)
    assert (found.t, found.p, found.df) == pytest.approx((theirs.statistic, theirs.pvalue, 3.0), rel=1e-12)
    assert (found.low, found.high) == pytest.approx(np.array(theirs.confidence_interval()) - 2.0, rel=1e-12)


@pytest.mark.parametrize("size", [0.5, 1.0, 2.0])
def test_power_agrees_with_statsmodels(size):
    one = TTestPower().power(size, nobs=6, alpha=0.05)
    assert power(size, 6**-0.5, 5.0) == pytest.approx(one, rel=1e-9)
    two = TTestIndPower().power(size, nobs1=5, alpha=0.05, ratio=2.0)
    assert power(size, np.sqrt(1 / 5 + 1 / 10), 13.0) == pytest.approx(two, rel=1e-9)


@pytest.mark.parametrize("df", [1.0, 2.0, 7.2, 60.0])
def test_the_detectable_difference_is_noticed_four_times_in_five(df):
    assert power(detectable(0.3, df), 0.3, df) == pytest.approx(0.8, abs=1e-9)


def test_a_difference_far_beyond_the_noise_cannot_be_missed():
    assert power(1e6, 1.0, 2.0) == pytest.approx(1.0)


def test_runs_without_spread_cannot_be_tested_and_do_not_pretend():
    found = confirm([3.0, 3.0], 2.0)
    assert np.isnan([found.t, found.p, found.power, found.detectable]).all()
    assert found.difference == 1.0


def test_failed_runs_do_not_count_as_confirmation():
    assert confirm([1.0, nan, 2.0], 1.0).runs == Sample(1.5, pytest.approx(0.5**0.5), 2)
    with pytest.raises(BadInput, match="at least 2"):
        confirm([1.0, nan], 1.0)


def test_an_exact_number_has_no_variance():
    assert Sample(2.0).variance_of_mean == 0.0
    assert Sample(2.0).n == inf


def test_three_factors_are_searched_as_two():
    made = box_behnken(unit_factors("abc"))
    law = 5.0 - (made.coded - [0.2, -0.3, 0.9]) ** 2 @ [1.0, 2.0, 3.0]
    fit = fit_model(made.with_responses(y=law), "y", "quadratic")
    assert optimise([fit], [Goal("y", "maximise")]).optima[0].coded == pytest.approx(
        [0.2, -0.3, 0.9], abs=1e-4
    )
