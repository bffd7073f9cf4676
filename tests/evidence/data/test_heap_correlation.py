"""Correlation of rows of one heap, from repeats of a laboratory and from replicates of a model."""

from dataclasses import replace

import numpy as np
import pytest

from doe.trials.reduced.laboratory import Readings, table_of
from taichi_erosion.evidence.data.comparison_rows import comparison_rows
from taichi_erosion.evidence.data.heap_correlation import HeapCorrelation, correlated, heap_correlation
from taichi_erosion.evidence.data.problem import Floats, Measurements, Observable, Problem, Replicates

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
    assert "angle and height of one heap scatter together" in found[0].sentences[0]


def test_independent_observables_are_seldom_called_correlated():
    found = [correlation_of(table(12, 3, seed, rho=0.0)) for seed in range(200)]
    seen = sum(each is not None for each in found)
    # lambda <= 1/4 means |r| >= 0.36 of 24 degrees of freedom, p = 0.077: 15.4 of 200, sd 3.8
    assert 4 <= seen <= 27


def shared(measured: Measurements) -> Floats:
    """Correlation of rows of angle and height, of which single heaps have TRUE in common."""
    rows = comparison_rows(problem_of(measured), measured)
    heaps = HeapCorrelation(("angle", "height"), np.array([[1.0, TRUE], [TRUE, 1.0]]))
    return correlated(rows, heaps).covariance / np.sqrt(np.outer(rows.variance, rows.variance))


def test_means_over_common_heaps_are_correlated_by_their_share_of_them():
    # six rows of angle, then six of height; each pair of means of the same four heaps
    wanted = TRUE * np.kron(np.array([[0.0, 1.0], [1.0, 0.0]]), np.eye(6))
    np.testing.assert_allclose(shared(table(6, 4, 1)), wanted, atol=1e-12)
    fewer = table(1, 4, 1, sd=1.0).rows(np.arange(5))  # four angles and the height of the first heap
    # angle: mean of four, height: one of them; cov / (s_a s_b) = rho 1 / sqrt(4 * 1)
    assert shared(fewer)[0, 1] == pytest.approx(TRUE / 2.0)


def test_replicates_of_a_model_count_as_far_as_its_scatter_goes():
    measured = table(6, 1, 0, n=4.0, sd=1.0)
    model = Replicates(("angle", "height"), np.array([0.5, 10.0]), np.array([[1.0, 0.6], [0.6, 1.0]]))
    found = correlation_of(measured, model)
    # the sd of six cells of four repeats has 18 degrees of freedom: variance of the t distribution 18 / 16
    assert found.matrix[0, 1] == pytest.approx(0.6 * 0.5 / np.sqrt(18.0 / 16.0), rel=1e-9)
