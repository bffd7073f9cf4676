"""Least squares over many columns at once, column by column against stacked rows."""

import numpy as np
import pytest

from taichi_erosion.evidence.data.linear_algebra import ColumnRows, working

ROWS, NUMBERS, COLUMNS = 14, 3, 5


def drawn(censored: bool) -> tuple[ColumnRows, np.ndarray]:
    random = np.random.default_rng(4)
    reach = np.zeros(ROWS)
    if censored:
        reach[[1, 6, 9]] = [-np.inf, np.inf, 0.8]
    design = random.standard_normal((ROWS, NUMBERS))
    residual = 2.0 * random.standard_normal((ROWS, COLUMNS))
    return ColumnRows(design, residual, reach), random.standard_normal((NUMBERS, COLUMNS))


@pytest.mark.parametrize("censored", [False, True])
@pytest.mark.parametrize("factor", [1.0, 1.7])
def test_every_column_is_solved_as_if_it_were_alone(censored, factor):
    rows, x = drawn(censored)
    found = rows.solved(x, factor)
    for column in range(COLUMNS):
        work = working(rows.residual[:, column] / factor, rows.reach / factor)
        slopes = rows.design / factor * work.weight[:, np.newaxis]
        stacked = np.vstack([slopes, np.eye(NUMBERS)])
        target = np.concatenate([work.residual, -x[:, column]])
        best, *_ = np.linalg.lstsq(stacked, target, rcond=None)
        left = target - stacked @ best
        above = work.deviance - float(work.residual @ work.residual)
        assert found.change[:, column] == pytest.approx(best)
        assert found.misfit[column] == pytest.approx(float(left @ left) + above)
        matrix = stacked.T @ stacked
        assert found.of(column) == pytest.approx(np.linalg.inv(matrix))
        volume = np.broadcast_to(found.log_determinant, COLUMNS)[column]
        assert volume == pytest.approx(np.linalg.slogdet(matrix)[1])
        assert found.sd(0).shape[0] == 0, "a study may calibrate nothing"
        spread = np.broadcast_to(found.sd(2), (2, COLUMNS))[:, column]
        assert spread == pytest.approx(np.sqrt(np.diag(np.linalg.inv(matrix))[:2]))


def test_censored_rows_have_weights_of_their_own_in_every_column():
    rows, x = drawn(True)
    found = rows.solved(x, 1.0)
    assert found.covariance.shape == (COLUMNS, NUMBERS, NUMBERS)
    assert np.ptp(found.log_determinant) > 0.0
