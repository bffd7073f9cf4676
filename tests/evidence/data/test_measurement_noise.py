"""Scatter of the laboratory out of few repeats: weights that neither trust chance nor lose what is known."""

import numpy as np
import pytest

from taichi_erosion.evidence.data.measurement_noise import likely_shape, moderated

ROWS, REPEATS = 12, 3
FREEDOM = np.full(ROWS, REPEATS - 1.0)
EVEN = np.ones((1, ROWS))


def sample_variances(random: np.random.Generator, sd: np.ndarray, repeats: int = REPEATS) -> np.ndarray:
    return np.var(sd * random.standard_normal((repeats, sd.size)), axis=0, ddof=1)


def test_rows_of_one_scatter_share_one_variance():
    variance, freedom = moderated(
        sample_variances(np.random.default_rng(1), np.full(ROWS, 2.0)), FREEDOM, EVEN
    )
    assert np.ptp(variance) == 0.0
    assert freedom == ROWS * (REPEATS - 1)
    # a pooled variance of 24 degrees of freedom has a relative sd of sqrt(2 / 24)
    assert variance[0] == pytest.approx(4.0 * 24 / 22, rel=3.0 * np.sqrt(2.0 / 24.0))


def test_rows_that_differ_beyond_chance_keep_their_own_variance():
    sd = np.where(np.arange(ROWS) < ROWS // 2, 1.0, 10.0)
    variance, _ = moderated(sample_variances(np.random.default_rng(2), sd, 10), np.full(ROWS, 9.0), EVEN)
    assert variance[: ROWS // 2].max() < 0.2 * variance[ROWS // 2 :].min()


def test_scatter_that_grows_with_the_value_is_seen():
    value = np.geomspace(1.0, 8.0, ROWS)
    shapes = np.array([np.ones(ROWS), value])
    grown = likely_shape(sample_variances(np.random.default_rng(3), 0.1 * value), FREEDOM, shapes)
    flat = likely_shape(sample_variances(np.random.default_rng(3), np.ones(ROWS)), FREEDOM, shapes)
    assert np.all(np.diff(grown)[2:] > 0.0)
    assert np.ptp(flat) == 0.0


@pytest.mark.parametrize("spread", [0.0, 0.5])
def test_weights_out_of_three_repeats_make_no_outliers(spread):
    random, beyond, sets = np.random.default_rng(4), 0, 300
    for _ in range(sets):
        sd = np.exp(spread * random.standard_normal(ROWS))
        repeats = sd * random.standard_normal((REPEATS, ROWS))
        variance, _ = moderated(np.var(repeats, axis=0, ddof=1), FREEDOM, EVEN)
        beyond += int(np.sum(np.abs(repeats.mean(axis=0)) > 3.0 * np.sqrt(variance / REPEATS)))
    # over its own sd of three repeats a residual lies beyond 3 sd in 9.5 % of rows: less than a third of that
    assert beyond < 0.03 * sets * ROWS
