"""What to measure next: chance and information of normal distributions, studies of known answers."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats

from doe.trials.reduced.laboratory import Readings, table_of
from taichi_erosion.evidence.data.problem import Laboratory, Problem
from taichi_erosion.evidence.race.decision import decide_cause
from taichi_erosion.evidence.race.fit import Hypothesis
from taichi_erosion.evidence.race.posterior import Posterior, infer
from taichi_erosion.evidence.race.priors import SURE
from taichi_erosion.evidence.race.proposals import LEAST, Rival, best_design, clip_to_least_values, proposals
from taichi_erosion.evidence.record import ExperimentPart
from tests.evidence.linear_study import linear_problem

OUTCOMES = 512  # mirrored pairs under both explanations
WIDE = Laboratory(ranges={"x": (-3.0, 3.0)})
SHAPES = {"slope": lambda x: x, "cube": lambda x: 0.7 * x + 0.4 * x**3}


def rivals(*means: list[float], weights: tuple[float, ...] = (), level: float = 0.0) -> list[Rival]:
    """Effects `a`, `b`, ... whose outcomes have sd 1 and an error `level` in common."""
    share = weights or (1.0 / len(means),) * len(means)
    covariance = np.eye(len(means[0])) + level**2
    names = (Hypothesis((name,)) for name in "abcdefgh")
    return [Rival(*each, covariance) for each in zip(names, share, map(np.array, means), strict=False)]


@pytest.mark.parametrize("gap", [1.5, 2.5, 4.0])
def test_the_chance_of_deciding_between_two_is_that_of_a_likelihood_ratio(gap):
    ((_, chance),) = best_design(rivals([0.0], [gap]), np.ones(1))
    # ln L1 / L2 ~ N(gap^2 / 2, gap^2) is beyond ln 9 on either side
    line, ratio = np.log(SURE / (1.0 - SURE)), stats.norm(0.5 * gap**2, gap)
    exact = float(ratio.sf(line) + ratio.cdf(-line))
    assert chance == pytest.approx(exact, abs=4.0 * float(np.sqrt(exact * (1.0 - exact) / OUTCOMES)))


def information(gap: float) -> float:
    """About which of two equally likely unit normals holds, by quadrature [nat]."""

    def density(y: float) -> float:
        first, second = stats.norm.pdf(y), stats.norm.pdf(y - gap)
        return float(first * np.log(2.0 * first / (first + second)))

    return integrate.quad(density, -8.0, 8.0)[0]


def test_least_is_the_information_of_two_explanations_that_are_0_4_sd_apart():
    assert information(0.4) == pytest.approx(LEAST, rel=0.05)


def test_the_most_informative_measurement_for_its_cost_comes_first():
    two = rivals([0.0, 0.0, 0.0], [1.0, 2.0, 3.0])
    assert best_design(two, np.ones(3))[0][0] == 2
    assert best_design(two, np.array([1.0, 1.0, 1.5 * information(3.0) / information(2.0)]))[0][0] == 1


def test_nothing_that_separates_two_by_0_2_sd_is_proposed():
    assert best_design(rivals([0.0] * 30, [0.2] * 30), np.ones(30)) == []
    assert [at for at, _ in best_design(rivals([0.0] * 30, [3.0] + [0.2] * 29), np.ones(30))] == [0]


def test_amounts_below_the_least_that_is_seen_tell_nothing():
    seen = clip_to_least_values(rivals([-9.0, 0.0], [-4.0, 3.0]), np.full(2, -1.0))
    assert [at for at, _ in best_design(seen, np.ones(2))] == [1]


def test_after_a_measurement_with_a_common_error_comes_one_that_cancels_it():
    # alone, 0 tells most; beside it 1 has the same error and the same sign, 2 the opposite sign
    told = best_design(rivals([0.0, 0.0, 0.0], [2.1, 2.0, -1.5], level=2.0), np.ones(3))
    assert [at for at, _ in told[:2]] == [0, 2]


def test_chances_rise_and_an_answer_that_all_explanations_share_is_no_decision():
    three = rivals([0.0, 0.0], [3.0, 0.0], [0.0, 3.0], weights=(0.4, 0.3, 0.3))
    names = [("a",), ("a", "b"), ("a", "c")]
    three = [replace(r, hypothesis=Hypothesis(n)) for r, n in zip(three, names, strict=True)]
    chances = [chance for _, chance in best_design(three, np.ones(2))]
    assert 0.0 < chances[0] < 1.0, "`a` is right from the start, whether it is alone is not"
    assert np.all(np.diff(chances) > LEAST)


def undecided(problem: Problem) -> Posterior:
    found = infer(problem, 1)
    assert decide_cause(found).verdict != "present"
    return found


def measured(problem: Problem, told: tuple[ExperimentPart, ...], strength: float) -> Problem:
    """The table with what a world of `slope` gives where it was asked."""
    x = np.array([each.conditions["x"] for each in told])
    table, sd = problem.measurements, 0.1 / np.sqrt(WIDE.repeats)
    value = strength * x + sd * np.random.default_rng(3).standard_normal(x.size)
    rows = (table.conditions["x"], table.value, table.sd)
    joined = [np.append(old, new) for old, new in zip(rows, (x, value, np.full(x.size, sd)), strict=True)]
    groups = (*table.group, *(f"new{k}" for k in range(x.size)))
    return replace(problem, measurements=table_of([Readings("y", {"x": joined[0]}, *joined[1:], groups)]))


def test_two_effects_are_told_apart_where_they_differ_and_the_truth_is_named_then():
    # measured on [-1, 1] a slope and a cube are alike; they part at the ends of a wider range
    problem = linear_problem(SHAPES, {"slope": 0.3}, sd=0.1)
    told = proposals(undecided(problem), WIDE)
    first = told[0]
    assert abs(first.conditions["x"]) == pytest.approx(3.0)
    assert {"slope", "cube"} <= set(first.predictions)
    assert decide_cause(infer(measured(problem, told, 0.3), 1)).named == ("slope",)


def test_a_decided_study_and_one_of_copies_ask_for_nothing():
    decided = infer(linear_problem({"slope": lambda x: x, "square": lambda x: x**2}, {"slope": 1.0}), 1)
    assert decide_cause(decided).named == ("slope",)
    copies = undecided(linear_problem({"slope": lambda x: x, "copy": lambda x: x}, {"slope": 0.6}))
    assert proposals(decided, WIDE) == proposals(copies, WIDE) == ()
