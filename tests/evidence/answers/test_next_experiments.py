"""Design of the next experiments: covariance updates, the choice, the chance of deciding."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.answers.next_experiments import (
    OUTCOMES,
    DesignPool,
    RivalPrediction,
    decision_chance,
    greedy_design,
    next_experiments,
    rank_one_update,
)
from taichi_erosion.evidence.data.problem import Budget, Laboratory
from taichi_erosion.evidence.inference.levels import DECIDED
from tests.evidence.linear_study import linear_problem


def pool(variance: list[float], cost: list[float] | None = None) -> DesignPool:
    rows = SimpleNamespace(size=len(variance))
    return DesignPool(None, rows, np.array(variance), np.array(cost or [1.0] * len(variance)))


def rival(mean: list[float], weight: float = 0.5, root: np.ndarray | None = None) -> RivalPrediction:
    size = len(mean)
    return RivalPrediction("r", weight, np.array(mean), np.zeros((size, 1)) if root is None else root)


def test_an_update_conditions_the_covariance_on_one_measurement():
    root = np.random.default_rng(1).standard_normal((5, 3))
    prior = root @ root.T
    after = rank_one_update(root, 2, 0.7)
    exact = prior - np.outer(prior[:, 2], prior[2]) / (prior[2, 2] + 0.7)
    assert after @ after.T == pytest.approx(exact)
    assert rank_one_update(np.zeros((3, 2)), 1, 0.7) == pytest.approx(np.zeros((3, 2)))


def test_the_measurement_with_the_largest_difference_for_its_noise_and_cost_comes_first():
    rivals = [rival([0.0, 0.0, 0.0]), rival([1.0, 2.0, 2.1])]
    assert greedy_design(pool([1.0, 1.0, 1.0]), rivals)[0] == 2
    assert greedy_design(pool([1.0, 1.0, 9.0]), rivals)[0] == 1
    assert greedy_design(pool([1.0, 1.0, 1.0], [0.1, 1.0, 1.0]), rivals)[0] == 0


def test_a_difference_that_a_rival_may_refit_away_is_worth_less():
    loose = np.array([[0.0], [10.0]])  # the second prediction is uncertain by ten
    rivals = [rival([0.0, 0.0]), rival([1.0, 3.0], root=loose)]
    assert greedy_design(pool([1.0, 1.0]), rivals)[0] == 0


def test_rivals_that_predict_the_same_ask_for_nothing():
    assert greedy_design(pool([1.0, 1.0]), [rival([1.0, 2.0]), rival([1.0, 2.0])]) == []


@pytest.mark.parametrize("gap", [1.0, 2.5, 4.0])
def test_the_chance_of_deciding_between_two_is_that_of_a_likelihood_ratio(gap):
    rivals, both = [rival([0.0]), rival([gap])], pool([1.0])
    # ln L1 / L2 ~ N(gap^2 / 2, gap^2) must exceed ln 9
    exact = stats.norm.sf((np.log(DECIDED / (1.0 - DECIDED)) - 0.5 * gap**2) / gap)
    sd = np.sqrt(exact * (1.0 - exact) / (2 * OUTCOMES))
    assert decision_chance(both, rivals, [0], seed=1) == pytest.approx(exact, abs=4.0 * sd + 1e-3)


def test_an_experiment_is_proposed_where_two_effects_differ_most():
    # measured on [-1, 1] a slope and a cube are alike; they part at the end of a wider range
    shapes = {"slope": lambda x: x, "cube": lambda x: 0.7 * x + 0.4 * x**3}
    problem = linear_problem(shapes, {"slope": 0.25}, sd=0.1)
    found = discover(problem, 1, Budget(), lambda stage, share: None)
    assert {"slope", "cube"} <= {*found.named, *found.group} or found.verdict == "not_testable"
    first, *_ = next_experiments(problem, found, Laboratory(ranges={"x": (-3.0, 3.0)}))
    assert abs(first.conditions["x"]) == pytest.approx(3.0)
    assert first.chance > 0.2
