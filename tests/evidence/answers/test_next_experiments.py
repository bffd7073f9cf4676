"""Design of the next experiments: the choice, the chance of deciding."""

from dataclasses import replace
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
)
from taichi_erosion.evidence.data.findings import PlausibleHypothesis
from taichi_erosion.evidence.data.problem import Budget, Laboratory
from taichi_erosion.evidence.inference.verdict_levels import DECIDED
from tests.evidence.linear_study import linear_problem


def pool(variance: list[float], cost: list[float] | None = None) -> DesignPool:
    size = len(variance)
    rows = SimpleNamespace(size=size, which=np.arange(size))
    share = np.zeros((size, 1))
    return DesignPool(None, rows, np.array(variance), np.array(cost or [1.0] * size), share)


def rival(mean: list[float], weight: float = 0.5, root: np.ndarray | None = None) -> RivalPrediction:
    size = len(mean)
    return RivalPrediction("r", weight, np.array(mean), np.zeros((size, 1)) if root is None else root)


def test_the_measurement_with_the_largest_difference_for_its_noise_and_cost_comes_first():
    rivals = [rival([0.0, 0.0, 0.0]), rival([1.0, 2.0, 2.1])]
    assert greedy_design(pool([1.0, 1.0, 1.0]), rivals)[0] == 2
    assert greedy_design(pool([1.0, 1.0, 9.0]), rivals)[0] == 1
    assert greedy_design(pool([1.0, 1.0, 1.0], [0.1, 1.0, 1.0]), rivals)[0] == 0


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
    told = next_experiments(problem, found, Laboratory(ranges={"x": (-3.0, 3.0)}))
    first, *others = told.experiments
    assert abs(first.conditions["x"]) == pytest.approx(3.0)
    assert first.chance > 0.2
    assert "To tell" in told.sentence
    settings = np.array([each.conditions["x"] for each in (first, *others)])
    gaps = np.abs(settings[:, np.newaxis] - settings)[~np.eye(settings.size, dtype=bool)]
    assert gaps.min() > 0.02 * 6.0, "no setting is proposed twice"
    measured = problem.measurements.conditions["x"]
    assert np.abs(settings[:, np.newaxis] - measured).min() > 0.02 * 6.0, "nor one that is measured already"


def answer(problem, **changes):
    """An answer of `discover` with made-up explanations, for the planner alone."""
    return replace(discover(problem, 1, Budget("quick"), lambda stage, share: None), **changes)


def explanation(probability: float, **strengths: float) -> PlausibleHypothesis:
    return PlausibleHypothesis(tuple(strengths), probability, {"level": 0.0}, strengths)


SHAPES = {"slope": lambda x: x, "cube": lambda x: x**3, "step": lambda x: np.where(x > 2.0, 1.0, 0.0)}
WIDE = Laboratory(ranges={"x": (-3.0, 3.0)})


def test_the_named_effect_is_told_from_its_real_runner_up():
    problem = linear_problem(SHAPES, {"slope": 1.0}, sd=0.1)
    live = (explanation(0.7, slope=1.0), explanation(0.25, cube=1.3), explanation(1e-4))
    found = answer(problem, verdict="present", named=("slope",), survivors=live)
    told = next_experiments(problem, found, WIDE)
    assert set(told.explanations) == {"slope", "cube"}, "an explanation that is excluded asks for nothing"
    assert told.sentence.startswith("To tell slope from cube")
    assert all(set(each.predictions) == {"slope", "cube"} for each in told.experiments)
