"""Errors of stated conditions, against closed forms of a straight line with errors in both variables."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.data.problem import Candidate, Problem
from taichi_erosion.evidence.inference.map_fit import fit
from taichi_erosion.evidence.inference.marginal_likelihood import expand, score
from taichi_erosion.evidence.inference.posterior import strength_estimates
from taichi_erosion.evidence.models.prepared_problem import PreparedProblem, prepare
from tests.evidence.linear_study import linear_problem

SD, SD_X, SLOPE, COUNT = 0.1, 0.25, 1.2, 24
DRAWS = 200  # of tables, for a coverage known to 2 %


def line(seed: int, classical: bool = True, told: bool = True, slope: float = SLOPE) -> Problem:
    """y = slope x + e, stated x off by N(0, SD_X^2): measured so (classical), or set so (Berkson)."""
    generator = np.random.default_rng(seed)
    problem = linear_problem({"slope": lambda x: x}, {"slope": 0.0}, sd=SD, count=COUNT, seed=None)
    set_x = problem.measurements.conditions["x"]
    other = set_x + SD_X * generator.standard_normal(COUNT)
    stated, true = (other, set_x) if classical else (set_x, other)
    table = replace(
        problem.measurements,
        value=slope * true + SD * generator.standard_normal(COUNT),
        conditions={"x": stated},
        condition_sd={"x": np.full(COUNT, SD_X)} if told else {},
        condition_set=frozenset() if classical else frozenset({"x"}),
    )
    return replace(problem, measurements=table, candidates=(Candidate("slope", 10.0, 30.0),))


def fitted(problem: Problem) -> tuple[PreparedProblem, float, float, float]:
    """Slope with its 90 % interval."""
    prepared = prepare(problem, problem.measurements, 1)
    best = fit(prepared, ("slope",), [np.array([0.0, 1.0])])
    estimate = strength_estimates(prepared, score(prepared, expand(prepared, best)))["slope"]
    return prepared, estimate.value, estimate.low, estimate.high


def deming(x: np.ndarray, y: np.ndarray, ratio: float) -> float:
    """Slope of a line with errors in both variables, `ratio` = var e_y / var e_x.

    Reference: Fuller (1987), Measurement Error Models, eq. 1.3.7.
    """
    xx, yy, xy = np.var(x), np.var(y), np.mean((x - x.mean()) * (y - y.mean()))
    gap = yy - ratio * xx
    return float((gap + np.sqrt(gap**2 + 4.0 * ratio * xy**2)) / (2.0 * xy))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_most_probable_slope_is_that_of_orthogonal_regression(seed):
    problem = line(seed)
    table = problem.measurements
    exact = deming(table.conditions["x"], table.value, (SD / SD_X) ** 2)
    prepared = prepare(problem, table, 1)
    best = fit(prepared, ("slope",), [np.array([0.0, 1.0])])
    naive = np.polyfit(table.conditions["x"], table.value, 1)[0]
    # priors of level and slope move it by less than 1e-3; three rounds leave 2 % of the bias
    assert best.psi[0] == pytest.approx(exact, abs=0.05 * abs(exact - naive) + 2e-3)
    assert abs(exact - naive) > 0.05, "without the errors the slope would be too flat"


@pytest.mark.slow
@pytest.mark.parametrize("classical", [True, False])
def test_intervals_hold_the_slope_where_the_condition_was_measured_and_where_it_was_set(classical):
    found = [fitted(line(100 + seed, classical)) for seed in range(DRAWS)]
    held = sum(low <= SLOPE <= high for _, _, low, high in found)
    low, high = stats.binom.ppf([0.005, 0.995], DRAWS, 0.9)
    assert low <= held <= high, held
    values = np.array([value for _, value, _, _ in found])
    assert np.mean(values) == pytest.approx(SLOPE, abs=3.0 * np.std(values) / np.sqrt(DRAWS))


@pytest.mark.slow
def test_without_the_errors_intervals_miss_the_slope():
    found = [fitted(line(100 + seed, told=False)) for seed in range(40)]
    # 40 draws of 0.9: 30 or fewer come with a probability of 0.15 %
    assert sum(low <= SLOPE <= high for _, _, low, high in found) <= 30


def test_without_a_slope_a_condition_has_no_error_to_pass_on():
    problem = line(5, slope=0.0)
    prepared = prepare(problem, problem.measurements, 1)
    assert np.all(prepared.model_errors(np.zeros(1), {}) == 0.0)
    columns = prepared.model_errors(np.zeros(1), {"slope": 2.0})
    assert np.sqrt(np.sum(columns**2, axis=1)) == pytest.approx(np.full(COUNT, 2.0 * SD_X))
