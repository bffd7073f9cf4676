"""The family-wise test: its threshold, its level under the null, its decoys."""

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.inference.familywise_test import familywise_test, power
from taichi_erosion.evidence.inference.verdict_levels import FAMILYWISE_LEVEL
from tests.evidence.linear_study import linear_problem, screened

SHAPES = {"slope": lambda x: x, "bend": lambda x: x**2, "wave": lambda x: np.sin(6.0 * x)}
ONE = {"slope": SHAPES["slope"]}
FACTORS = np.ones(2000)


def test_one_candidate_needs_the_one_sided_normal_quantile_and_more_candidates_need_more():
    one, many = (
        familywise_test(*screened(linear_problem(shapes, {})), FACTORS, 1) for shapes in (ONE, SHAPES)
    )
    quantile = stats.norm.ppf(1.0 - FAMILYWISE_LEVEL)
    # a 95 % quantile of 2000 draws has an sd of sqrt(0.05 0.95 / 2000) / phi = 0.047
    assert one.threshold == pytest.approx(quantile, abs=0.15)
    # three nearly orthogonal ones: Sidak's level
    assert many.threshold == pytest.approx(stats.norm.ppf(0.95 ** (1.0 / 3.0)), abs=0.15)
    assert power(one.threshold, one.threshold) == pytest.approx(0.5)
    assert power(0.0, 0.0) == 0.0, "an effect without a signature is never seen"


def test_under_the_null_the_level_holds():
    studies = (screened(linear_problem(SHAPES, {}, seed=seed)) for seed in range(80))
    p = [familywise_test(*study, np.ones(400), seed).p for seed, study in enumerate(studies)]
    # 5 % of 80 is 4, binomial sd 1.9: three sd above, and not never
    assert 1 <= sum(value < FAMILYWISE_LEVEL for value in p) <= 9


def test_a_true_effect_is_the_strongest_and_beats_every_decoy():
    test = familywise_test(*screened(linear_problem(SHAPES, {"bend": 1.0})), FACTORS, 1)
    assert int(np.argmax(test.observed)) == 1
    assert test.p < 0.01
    assert test.decoy_rank > 1
