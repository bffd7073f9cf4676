"""Coverage of predictions on closed-form cases, and what is told about them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from doe.trials.reduced.smooth import draw
from taichi_erosion.evidence.models.new_conditions import NewConditions
from taichi_erosion.evidence.prediction.predict import SHARE, check_of, predict
from tests.evidence.answers.test_held_out_misfit import silent_laboratory

CASES = 24


@pytest.mark.parametrize(
    ("discrepancy", "least"), [pytest.param(0.0, 0.86, marks=pytest.mark.slow), (1.0, 0.75)]
)
def test_intervals_hold_the_truth(discrepancy, least):
    """Bounds: three standard errors of the mean over CASES below the coverage told in doe/trials."""
    shares, single = [], []
    for seed in range(CASES):
        case = draw(5000 + seed, discrepancy)
        rows = predict(case.problem, NewConditions(case.observable, case.conditions)).rows
        shares.append(np.mean([r.low <= t <= r.high for r, t in zip(rows, case.truth, strict=True)]))
        pairs = zip(rows, case.measured, strict=True)
        single.append(np.mean([r.measured_low <= v <= r.measured_high for r, v in pairs]))
    assert least < np.mean(shares) < 0.98
    assert 0.85 < np.mean(single) < 0.95


def test_a_setting_beyond_the_measured_ones_is_flagged_and_less_certain():
    case = draw(1, 0.0)
    at = {"moisture": np.array([0.01, 0.06]), "diameter": np.array([3e-4, 3e-4])}
    near, far = predict(case.problem, NewConditions(("repose_angle",) * 2, at)).rows
    assert near.outside == ()
    assert far.outside[0].startswith("moisture 0.06 beyond 0.02")
    assert far.high - far.low > near.high - near.low
    assert near.measured_high - near.measured_low > near.high - near.low


def test_an_observable_without_known_scatter_is_told_and_left_out():
    case = draw(2, 0.0)
    table = case.problem.measurements
    angle = np.array([name == "repose_angle" for name in table.observable])
    blind = replace(table, sd=np.where(angle, np.nan, table.sd))
    found = predict(
        replace(case.problem, measurements=blind), NewConditions(case.observable, case.conditions)
    )
    assert {row.observable for row in found.rows} == {"threshold_u_star"}
    assert any("repose_angle is not predicted" in words for words in found.warnings)


def test_held_out_rows_check_the_intervals_only_where_the_vault_is_open():
    case = draw(3, 0.0)
    problem = replace(case.problem, vault=replace(case.problem.vault, rows=np.array([2, 5, 8, 20])))
    wanted = NewConditions(case.observable, case.conditions)
    assert predict(problem, wanted).held_out is None
    held_out = predict(problem, wanted, opened=True).held_out
    assert held_out is not None
    assert held_out.n == 4


def test_held_out_rows_of_a_source_without_a_scatter_count_with_an_estimated_one_as_in_adopt():
    problem = silent_laboratory()
    wanted = NewConditions(("y",), {"x": np.array([0.5])})
    found = predict(problem, wanted, opened=True)
    assert found.held_out is not None
    assert found.held_out.n == 24
    assert found.held_out.inside >= 19, "by chance as few or fewer in 8 %"
    (words,) = found.unstated_scatter
    assert "laboratory B states no scatter; its 24 held-out rows count with" in words
    assert words in found.sentences
    assert predict(problem, wanted).unstated_scatter == ()


def test_few_rows_inside_are_called_too_few():
    check = check_of(np.arange(20) < 12, np.ones(20, dtype=bool))
    assert (check.n, check.inside) == (20, 12)
    assert check.p == pytest.approx(stats.binom.cdf(12, 20, SHARE))
