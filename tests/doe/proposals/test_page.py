"""Bounds of a paired difference."""

import pytest
from scipy import stats

from doe.proposals.page import paired_difference


def test_the_bounds_exclude_zero_where_the_exact_test_rejects():
    for first, second in ((12, 3), (9, 4), (20, 5)):
        value, low, high = paired_difference(first, second, 100)
        assert value == pytest.approx((first - second) / 100)
        assert low < value < high
        rejected = stats.binomtest(first, first + second).pvalue < 0.05
        assert (low > 0.0) == rejected


def test_one_side_alone_and_no_difference():
    assert paired_difference(0, 0, 50) == (0.0, 0.0, 0.0)
    value, low, high = paired_difference(6, 0, 50)
    assert (value, high) == (pytest.approx(0.12), pytest.approx(0.12))
    assert low > 0.0
    assert paired_difference(0, 6, 50)[0] == pytest.approx(-0.12)
