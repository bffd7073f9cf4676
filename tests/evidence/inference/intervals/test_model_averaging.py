"""Averaged intervals against brute force: every kernel, amplitude, level and noise factor on a grid."""

from itertools import product

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.intervals.model_averaging import alone, average
from taichi_erosion.evidence.inference.map_fit import fit, fit_base
from taichi_erosion.evidence.inference.marginal_likelihood import expand, score
from taichi_erosion.evidence.inference.model_discrepancy import (
    AMPLITUDES,
    LENGTHS,
    condition_axes,
    discrepancy_gain,
    kernels,
)
from taichi_erosion.evidence.models.prepared_problem import LEVEL_WIDTHS, PreparedProblem, prepare
from taichi_erosion.evidence.inference.refit import FittedHypothesis
from tests.evidence.linear_study import LEVEL_SD, linear_problem

SHAPES = {"slope": lambda x: x, "bend": lambda x: x**2}


def fitted(prepared: PreparedProblem, names: tuple[str, ...] = (), start: float = 0.0):
    """One hypothesis with its evidence, and its average by itself."""
    best = fit(prepared, names, [np.append(prepared.prior_mean, [start] * len(names))])
    family, expansion = kernels(prepared), expand(prepared, best)
    gain = discrepancy_gain(prepared, expansion, family)
    item = FittedHypothesis(score(prepared, expansion), gain)
    return average(prepared, [alone(prepared, item, family)])


def brute_force(prepared: PreparedProblem, unit: float) -> tuple[np.ndarray, np.ndarray]:
    """Posterior of the level (in prior sd) of the bare model on a grid, without any of our algebra."""
    z, sd, size = prepared.rows.z, prepared.sd, prepared.rows.size
    grid = np.linspace(-1.0, 1.0, 4001)
    means = LEVEL_SD * grid[:, np.newaxis] + np.zeros(size)
    prior = stats.norm.logpdf(grid)
    (axis,) = condition_axes(prepared).values()
    square = (axis[:, np.newaxis] - axis) ** 2
    rest = levels.PRIOR_OUTSIDE / (levels.PRIOR_NONE + levels.PRIOR_OUTSIDE)
    cases = [(np.zeros((size, size)), np.log((1.0 - rest) * (1.0 - levels.PRIOR_LEVEL)), False)]
    for width in LEVEL_WIDTHS:
        one = np.full((size, size), (width * unit) ** 2)
        share = (1.0 - rest) * levels.PRIOR_LEVEL / len(LEVEL_WIDTHS)
        cases.append((one, np.log(share), False))
    for length, amplitude in product(LENGTHS, AMPLITUDES):
        smooth = amplitude**2 * np.exp(-0.5 * square / length**2) * np.outer(sd, sd)
        cases.append((smooth, np.log(rest / (len(LENGTHS) * len(AMPLITUDES))), True))
    total = []
    for factor, doubt in zip(prepared.doubt.factor, prepared.doubt.log_weight, strict=True):
        for covariance, weight, grows in cases:
            whole = np.diag((factor * sd) ** 2) + covariance * (factor**2 if grows else 1.0)
            density = stats.multivariate_normal(np.zeros(size), whole).logpdf(z - means)
            total.append(density + prior + weight + doubt)
    logs = log_sum_exp(np.array(total), axis=0)
    return grid, np.exp(logs - log_sum_exp(logs))


@pytest.mark.parametrize("bend", [0.0, 1.0])
def test_the_bare_models_number_is_that_of_brute_force(bend):
    problem = linear_problem(SHAPES, {"bend": bend}, sd=0.5, count=12, seed=3)
    prepared, _, _ = fit_base(prepare(problem, problem.measurements, 1))
    mixture = fitted(prepared).number(0)
    z = prepared.rows.z
    grid, weight = brute_force(prepared, max(np.median(np.abs(z)), np.std(z)))
    mean = weight @ grid
    sd = np.sqrt(weight @ (grid - mean) ** 2)
    for level in (0.05, 0.5, 0.95):
        exact = np.interp(level, np.cumsum(weight), grid)
        assert mixture.quantile(level) == pytest.approx(exact, abs=0.1 * sd)


def test_a_smooth_misfit_makes_a_calibrated_number_less_certain():
    exact, bent = (linear_problem(SHAPES, {"bend": size}, seed=5) for size in (0.0, 0.5))
    widths = []
    for problem in (exact, bent):
        prepared, _, _ = fit_base(prepare(problem, problem.measurements, 1))
        mixture = fitted(prepared).number(0)
        widths.append(mixture.quantile(0.95) - mixture.quantile(0.05))
    assert widths[1] > 2.0 * widths[0]
