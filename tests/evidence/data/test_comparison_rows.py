"""Rows on the comparison scale: censored values, and rows of one heap whose errors are correlated."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, stats

from doe.trials.reduced.laboratory import Readings, table_of
from taichi_erosion.evidence.answers.summary import race_record
from taichi_erosion.evidence.data.comparison_rows import censor_scale, comparison_rows
from taichi_erosion.evidence.data.heap_correlation import HeapCorrelation, add_correlation, heap_correlation
from taichi_erosion.evidence.data.problem import Floats, Measurements, Observable, Problem, Replicates
from taichi_erosion.evidence.data.transforms import working_residuals
from taichi_erosion.evidence.race.posterior import infer
from tests.evidence.linear_study import LEVEL_SD, linear_problem


def log_probability(u: float, reach: float) -> float:
    """Ln of the probability of the range about u in which a censored value lies."""
    if reach == -np.inf:
        return float(stats.norm.logcdf(u))
    if reach == np.inf:
        return float(stats.norm.logsf(u))
    return float(np.log(stats.norm.cdf(u + reach) - stats.norm.cdf(u - reach)))


@pytest.mark.parametrize("reach", [-np.inf, np.inf, 0.3, 2.0])
@pytest.mark.parametrize("u", [-3.0, -0.4, 0.0, 1.1, 4.0])
def test_a_censored_row_has_the_deviance_slope_and_curvature_of_its_likelihood(u, reach):
    work = working_residuals(np.array([u, 0.7]), np.array([reach, 0.0]))
    assert work.censored_deviance == pytest.approx(-2.0 * log_probability(u, reach) + 0.49, rel=1e-9)
    step = 1e-4
    low, here, high = (log_probability(u + k * step, reach) for k in (-1.0, 0.0, 1.0))
    slope, curvature = (high - low) / (2.0 * step), -(high - 2.0 * here + low) / step**2
    assert -work.residual[0] * work.weight[0] == pytest.approx(slope, rel=1e-5, abs=1e-7)
    assert work.weight[0] ** 2 == pytest.approx(curvature, rel=2e-3, abs=1e-5)
    assert (work.residual[1], work.weight[1]) == (0.7, 1.0)


@pytest.mark.parametrize("reach", [-np.inf, np.inf, 1.0])
def test_a_value_far_outside_its_range_stays_finite(reach):
    for u in (-60.0, 60.0):
        work = working_residuals(np.array([u]), np.array([reach]))
        assert np.isfinite([work.censored_deviance, work.residual[0], work.weight[0]]).all()


def test_an_interval_on_a_logarithmic_scale_keeps_its_ends():
    log = Observable("y", "log")
    value, reach = np.array([22.5, 5.0, 12.0]), np.array([2.5, 6.0, np.inf])
    z, span = censor_scale(log, value, reach)
    assert np.exp([z[0] - span[0], z[0] + span[0]]) == pytest.approx([20.0, 25.0])
    assert (np.exp(z[1]), span[1]) == (pytest.approx(11.0), -np.inf)  # from -1 to 11: only the upper end
    assert (np.exp(z[2]), span[2]) == (pytest.approx(12.0), np.inf)


def test_a_fit_to_limits_and_intervals_is_that_of_their_likelihood():
    problem = linear_problem({}, {}, sd=0.2, count=6)
    limit = np.array([0.4, -0.3, 0.2, np.nan, np.nan, np.nan])
    reach = np.array([np.inf, -np.inf, 0.15, 0.0, 0.0, 0.0])
    table = replace(problem.measurements, censored=np.isfinite(limit), limit=limit, reach=reach)
    found = infer(replace(problem, measurements=table), 1)
    assert np.isinf(found.race.prepared.rows.reach).sum() == 2

    ends = [(0.4, np.inf), (-np.inf, -0.3), (0.05, 0.35)]

    def deviance(level: float) -> float:
        total = -2.0 * stats.norm.logpdf(level, 0.0, LEVEL_SD)
        total -= 2.0 * stats.norm.logpdf(problem.measurements.value[3:], level, 0.2).sum()
        spans = [stats.norm.cdf(high, level, 0.2) - stats.norm.cdf(low, level, 0.2) for low, high in ends]
        return float(total - 2.0 * np.log(spans).sum())

    wanted = optimize.minimize_scalar(deviance, (0.0, 0.3)).x
    # the race has a scatter and a level beside it, each near nothing
    assert race_record(found).parameters["level"].value == pytest.approx(wanted, abs=0.03)


TRUE = 0.8


def table(
    cells: int, repeats: int, seed: int, rho: float = TRUE, n: float = 1.0, sd: float = np.nan
) -> Measurements:
    """Angles and heights of `repeats` heaps at every condition, single ones or means of n."""
    random = np.random.default_rng(seed)
    root = np.linalg.cholesky(np.array([[1.0, rho], [rho, 1.0]]))
    values = random.standard_normal((cells * repeats, 2)) @ root.T / np.sqrt(n)
    size, at = cells * repeats, np.repeat(np.arange(cells, dtype=float), repeats)
    groups = tuple(f"g{c:g}" for c in at)
    of = {"angle": (30.0, 1.0, values[:, 0]), "height": (10.0, 0.2, values[:, 1])}
    parts = [
        Readings(name, {"x": at}, middle + at + unit * own, np.full(size, unit * sd), groups)
        for name, (middle, unit, own) in of.items()
    ]
    return replace(table_of(parts, n), heap=tuple(f"heap {k}" for k in range(size)) * 2)


def problem_of(measured: Measurements) -> Problem:
    return Problem(measured, {"height": Observable("height", "log")}, (), (), lambda *_: np.zeros(1))


def correlation_of(measured: Measurements, replicates: Replicates | None = None) -> HeapCorrelation | None:
    return heap_correlation(comparison_rows(problem_of(measured), measured), measured, replicates)


def test_repeats_of_a_laboratory_give_their_correlation():
    found = [correlation_of(table(12, 3, seed)) for seed in range(20)]
    values = np.array([each.matrix[0, 1] for each in found if each is not None])
    assert len(values) == 20
    # 24 degrees of freedom: the sample correlation has an sd of 0.36 / sqrt(24) = 0.07, drawn to 0 by 1 / 25
    assert abs(values.mean() - TRUE * 24.0 / 25.0) < 3.0 * 0.075 / np.sqrt(20)


def test_independent_observables_are_seldom_called_correlated():
    found = [correlation_of(table(12, 3, seed, rho=0.0)) for seed in range(200)]
    seen = sum(each is not None for each in found)
    # lambda <= 1/4 means |r| >= 0.36 of 24 degrees of freedom, p = 0.077: 15.4 of 200, sd 3.8
    assert 4 <= seen <= 27


def shared(measured: Measurements) -> Floats:
    """Correlation of rows of angle and height, of which single heaps have TRUE in common."""
    rows = comparison_rows(problem_of(measured), measured)
    heaps = HeapCorrelation(("angle", "height"), np.array([[1.0, TRUE], [TRUE, 1.0]]))
    return add_correlation(rows, heaps).covariance / np.sqrt(np.outer(rows.variance, rows.variance))


def test_means_over_common_heaps_are_correlated_by_their_share_of_them():
    # six rows of angle, then six of height; each pair of means of the same four heaps
    wanted = TRUE * np.kron(np.array([[0.0, 1.0], [1.0, 0.0]]), np.eye(6))
    np.testing.assert_allclose(shared(table(6, 4, 1)), wanted, atol=1e-12)
    fewer = table(1, 4, 1, sd=1.0).pick_rows_at(np.arange(5))  # four angles and the height of the first heap
    # angle: mean of four, height: one of them; cov / (s_a s_b) = rho 1 / sqrt(4 * 1)
    assert shared(fewer)[0, 1] == pytest.approx(TRUE / 2.0)


def test_replicates_of_a_model_count_as_far_as_its_scatter_goes():
    measured = table(6, 1, 0, n=4.0, sd=1.0)
    model = Replicates(("angle", "height"), np.array([0.5, 10.0]), np.array([[1.0, 0.6], [0.6, 1.0]]))
    found = correlation_of(measured, model)
    # the sd of six cells of four repeats has 18 degrees of freedom: variance of the t distribution 18 / 16
    assert found.matrix[0, 1] == pytest.approx(0.6 * 0.5 / np.sqrt(18.0 / 16.0), rel=1e-9)


def test_the_last_digit_is_an_error_of_its_row_alone_less_of_a_mean():
    problem = linear_problem({}, {}, sd=0.05, count=3, seed=None)
    table = replace(problem.measurements, value=np.array([1.2, 1.3, 1.5]))
    equal = table.pick_rows_at(np.tile(np.arange(3), 2))  # which share their rounding
    other = replace(equal, value=equal.value + np.repeat([0.0, 0.1], 3))
    for share, repeats in ((1.0, table), (1.0, equal), (0.5, other)):
        rows = comparison_rows(problem, repeats)
        assert rows.rounding**2 == pytest.approx(np.full(3, share * 0.1**2 / 12.0))
        assert not rows.shared.any()


def test_an_error_between_codes_differs_by_half_at_each_diameter():
    problem = linear_problem({}, {}, sd=0.2, count=6)
    diameter = {"d": np.array([1.0, 1.0, 2.0, 2.0, 4.0, 4.0])}
    table = replace(problem.measurements, conditions=problem.measurements.conditions | diameter)
    for over, wanted in (("d", [5.0, 5.0, 4.0]), ("moisture", [4.0, 4.0, 4.0])):
        scale = Observable("y", sd_shared=2.0, shared_over=over)
        shared = comparison_rows(replace(problem, observables={"y": scale}), table).shared
        assert (shared @ shared.T)[0, :3] == pytest.approx(wanted)
