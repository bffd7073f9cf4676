"""The mixture against closed forms: regression without a discrepancy, and quantiles of a known mixture."""

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.data.measurement_noise import NoiseLevelPrior
from taichi_erosion.evidence.prediction.discrepancy_mixture import (
    JointRows,
    Mixture,
    given_state,
    joint_prediction,
    log_likelihood,
)

RIGHT = NoiseLevelPrior(np.ones(1), np.zeros(1))
NOTHING = ((0.0, 0.35),), 0


def straight_line(count: int = 12, sd: float = 0.2, bend: float = 0.0) -> JointRows:
    """A line with two numbers of prior N(0, 1) through rows at -1 to 1, asked at 0.5 and 3."""
    x = np.append(np.linspace(-1.0, 1.0, count), [0.5, 3.0])
    y = 0.3 + 0.8 * x[:count] + bend * np.sin(3.0 * x[:count])
    y = y + sd * np.random.default_rng(3).normal(size=count)
    design = np.column_stack([np.ones(x.size), x])
    parts = {"calibration": design, "instrument": np.zeros((x.size, 0)), "emulator": np.zeros((x.size, 0))}
    axes = (x / np.std(x[:count]))[:, np.newaxis]
    which = np.zeros(x.size, dtype=np.int64)
    return JointRows(y, np.full(count, sd**2), np.zeros(2), parts, axes, which, np.array([sd]), RIGHT)


def test_without_a_discrepancy_it_is_bayesian_linear_regression():
    rows = straight_line()
    design, new = rows.parts["calibration"][:12], rows.parts["calibration"][12:]
    covariance = np.linalg.inv(design.T @ design / 0.04 + np.eye(2))
    found = given_state(rows, NOTHING)
    assert found["whole"][0] == pytest.approx(new @ covariance @ design.T @ rows.residual / 0.04)
    assert found["whole"][1] == pytest.approx(np.einsum("ij,jk,ik->i", new, covariance, new))
    whole = design @ design.T + 0.04 * np.eye(12)
    square = rows.residual @ np.linalg.solve(whole, rows.residual)
    assert log_likelihood(rows, NOTHING) == pytest.approx(-0.5 * (square + np.linalg.slogdet(whole)[1]))


def test_a_row_left_out_is_predicted_as_if_it_had_not_been_measured():
    rows = straight_line()
    mean, variance = given_state(rows, NOTHING)["left out"]
    kept = np.arange(12) != 4
    design = rows.parts["calibration"][:12]
    covariance = np.linalg.inv(design[kept].T @ design[kept] / 0.04 + np.eye(2))
    assert mean[4] == pytest.approx(design[4] @ covariance @ design[kept].T @ rows.residual[kept] / 0.04)
    assert variance[4] == pytest.approx(design[4] @ covariance @ design[4] + 0.04)


def test_a_clear_discrepancy_is_found_and_widens_the_interval_where_nothing_was_measured():
    plain, bent = (joint_prediction(straight_line(24, 0.05, bend), seed=1) for bend in (0.0, 0.5))
    assert plain.discrepancy_odds < 3.0 < bent.discrepancy_odds
    truth = 0.3 + 0.8 * 0.5 + 0.5 * np.sin(1.5)
    low, high = bent.whole.quantile(0.05), bent.whole.quantile(0.95)
    assert low[0] < truth < high[0]
    assert (high - low)[1] > 4.0 * (high - low)[0]


def test_quantiles_are_those_of_the_mixture():
    mixture = Mixture(np.array([0.3, 0.7]), np.array([[0.0], [4.0]]), np.array([[1.0], [0.25]]))
    for share in (0.05, 0.3, 0.9):
        value = float(mixture.quantile(share)[0])
        below = 0.3 * stats.norm.cdf(value) + 0.7 * stats.norm.cdf(value, 4.0, 0.5)
        assert below == pytest.approx(share, abs=1e-9)
