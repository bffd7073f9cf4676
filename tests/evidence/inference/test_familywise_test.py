"""The family-wise test: its level under the null, its step-down, its decoys."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.inference.familywise_test import decoy_rank, familywise_test, power, step_down
from taichi_erosion.evidence.inference.verdict_levels import FAMILYWISE_LEVEL
from tests.evidence.linear_study import linear_problem, screened

SHAPES = {"slope": lambda x: x, "bend": lambda x: x**2, "wave": lambda x: np.sin(6.0 * x)}
ONE = {"slope": SHAPES["slope"]}
FACTORS = np.ones(2000)


def test_step_down_compares_with_the_maximum_over_itself_and_the_weaker_ones():
    drawn = np.array([[0.0, 1.0, 2.0, 5.0], [4.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 3.5]])
    p = step_down(np.array([3.0, 4.5, 0.5]), drawn)
    # candidate 1: maxima 4 1 2 5 over all, one reaches 4.5; candidate 0: 0 1 2 5 with 2, one reaches 3;
    # candidate 2 alone: 3.5 once reaches 0.5; each (1 + hits) / (1 + 4)
    assert p == pytest.approx([0.4, 0.4, 0.4])
    assert step_down(np.array([3.0, 6.0, 0.5]), drawn) == pytest.approx([0.4, 0.2, 0.4])


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


def test_a_decoy_ranks_first_where_no_candidate_describes_the_misfit():
    # a broad arch, which smooth made-up effects meet and a fast wave and a falling line do not
    shapes = {"wave": SHAPES["wave"], "fall": lambda x: -x}
    problem = linear_problem({**shapes, "arch": lambda x: x + 0.5 * x**3}, {"arch": 1.0})
    unlisted = [c for c in problem.candidates if c.name != "arch"]
    ranks = [
        familywise_test(*screened(replace(problem, candidates=tuple(unlisted))), np.ones(50), seed).decoy_rank
        for seed in range(8)
    ]
    assert min(ranks) == 1


def test_the_rank_of_a_decoy_counts_the_candidates_before_it():
    prepared, found = screened(linear_problem(SHAPES, {}))
    silent = replace(found, left=replace(found.left, stacked=np.zeros_like(found.left.stacked)))
    # without a residual every effect loses evidence: a decoy of typical norm falls below 0, and above -10
    ranks = [
        decoy_rank(prepared, silent, np.array(observed), np.random.default_rng(3))
        for observed in ([0.0, 0.0, -10.0], [0.0, -10.0, -10.0], [-10.0, -10.0, -10.0])
    ]
    assert ranks == [3, 2, 1]
