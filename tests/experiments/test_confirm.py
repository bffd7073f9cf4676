"""Confirmation runs and the power of their test, against answers known beforehand."""

from math import nan

import numpy as np
import pytest
from scipy import stats
from statsmodels.stats.power import TTestIndPower, TTestPower

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.confirm import Sample, least_detectable_difference, power, welch_test


def test_welchs_test_agrees_with_scipy():
    values = [33.02, 32.52, 33.18]
    mean, sd = np.mean(values), np.std(values, ddof=1)
    theirs = stats.ttest_ind_from_stats(mean, sd, 3, 33.52, 0.68, 10, equal_var=False)
    found = welch_test(values, Sample(33.52, 0.68, 10))
    assert (found.t, found.p) == pytest.approx((theirs.statistic, theirs.pvalue), rel=1e-12)


@pytest.mark.parametrize("size", [0.5, 1.0, 2.0])
def test_power_agrees_with_statsmodels(size):
    assert power(size, 6**-0.5, 5.0) == pytest.approx(TTestPower().power(size, nobs=6, alpha=0.05), rel=1e-9)
    two = TTestIndPower().power(size, nobs1=5, alpha=0.05, ratio=2.0)
    assert power(size, np.sqrt(1 / 5 + 1 / 10), 13.0) == pytest.approx(two, rel=1e-9)


@pytest.mark.parametrize("df", [1.0, 2.0, 7.2, 60.0])
def test_the_detectable_difference_is_noticed_four_times_in_five(df):
    assert power(least_detectable_difference(0.3, df), 0.3, df) == pytest.approx(0.8, abs=1e-9)


def test_failed_runs_do_not_count_as_confirmation():
    assert welch_test([1.0, nan, 2.0], 1.0).runs == Sample(1.5, pytest.approx(0.5**0.5), 2)
    with pytest.raises(BadInput, match="at least 2"):
        welch_test([1.0, nan], 1.0)
