"""Adoption: what the held-out rows say for and against an effect."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.answers.adopt import adopt, judged
from taichi_erosion.evidence.data.findings import Adoption, HypothesisFit, Rows
from taichi_erosion.evidence.data.problem import Observable, Vault
from tests.evidence.linear_study import LEVEL_SD, linear_problem

NO_ROWS = Rows((), (), {}, *[np.zeros(0)] * 8, limit=())


def fit(chi2: float, *effects: str) -> HypothesisFit:
    return HypothesisFit(effects, {}, {}, 40.0, chi2, {}, NO_ROWS, None)


@pytest.mark.parametrize(
    ("before", "after", "told"), [(40.0, 38.0, True), (40.0, 4.0, False), (1.4, 1.3, False)]
)
def test_adopting_says_where_the_held_out_rows_contradict_the_name(before, after, told):
    found = Adoption(effect="liquid_bridge", base=fit(before), added=fit(after, "liquid_bridge"))
    assert judged(found).contradicted == told


def test_errors_of_held_out_rows_are_those_of_a_normal_with_what_calibration_leaves_open():
    problem = linear_problem({"slope": lambda x: x}, {"slope": 1.0}, sd=0.1, seed=2)
    held = np.arange(0, 24, 3)
    found = adopt(replace(problem, vault=Vault(held)), ["slope"], 1)
    x, z = problem.measurements.conditions["x"], problem.measurements.value
    seen = np.setdiff1d(np.arange(24), held)
    design = np.column_stack([x, np.ones(24)])
    prior = np.diag([0.0, LEVEL_SD**-2])
    covariance = np.linalg.inv(design[seen].T @ design[seen] / 0.01 + prior)
    gap = z[held] - design[held] @ covariance @ design[seen].T @ z[seen] / 0.01
    whole = 0.01 * np.eye(held.size) + design[held] @ covariance @ design[held].T
    sd = np.sqrt(np.diag(whole))
    rows = found.added.vault_rows
    assert rows is not None
    # the strength's prior of 1.5 moves its best value, and its variance, by a thousandth
    assert rows.residual == pytest.approx(gap / sd, abs=0.02)
    assert rows.residual_error == pytest.approx(sd, rel=0.01)
    assert found.added.vault_chi2_per_row == pytest.approx(np.mean(rows.residual**2))
    drawn = np.random.default_rng(0).standard_normal((20000, held.size)) @ np.linalg.cholesky(whole).T
    exact = np.mean(np.sum((drawn / sd) ** 2, axis=1) > np.sum((gap / sd) ** 2))
    assert found.added.vault_p == pytest.approx(exact, abs=0.03)  # 20,000 draws know p to 0.004
    score = np.mean(stats.norm.logpdf(gap, scale=sd)) + 0.5 * np.log(2.0 * np.pi)
    assert found.added.vault_log_score == pytest.approx(score, abs=0.02)
    assert found.base.vault_p < 1e-6


def test_errors_that_rows_share_are_as_the_visible_rows_leave_them():
    # a level that is measured only beside an error that all rows share: rows predict each other exactly so
    problem = linear_problem({"slope": lambda x: x}, {"slope": 1.0}, sd=0.1, seed=4, calibrated=False)
    held = np.arange(0, 24, 3)
    problem = replace(problem, vault=Vault(held), observables={"y": Observable("y", sd_shared=2.0)})
    table = replace(problem.measurements, value=problem.measurements.value + 3.0)
    found = adopt(replace(problem, measurements=table), ["slope"], 1)
    x, z = table.conditions["x"], table.value
    seen = np.setdiff1d(np.arange(24), held)
    design = np.column_stack([x, 2.0 * np.ones(24)])
    covariance = np.linalg.inv(design[seen].T @ design[seen] / 0.01 + np.diag([0.0, 1.0]))
    gap = z[held] - design[held] @ covariance @ design[seen].T @ z[seen] / 0.01
    sd = np.sqrt(0.01 + np.einsum("ij,jk,ik->i", design[held], covariance, design[held]))
    rows = found.added.vault_rows
    assert rows is not None
    assert rows.residual == pytest.approx(gap / sd, abs=0.03)
    assert rows.residual_error == pytest.approx(sd, rel=0.01)


def test_all_hypotheses_are_held_against_the_rows_that_each_has_a_value_for():
    problem = linear_problem({"slope": lambda x: x, "bend": lambda x: x**2}, {"slope": 1.0}, seed=2)
    bare = problem.model

    def partly(observable, conditions, parameters, effects, seeds):
        value = bare(observable, conditions, parameters, effects, seeds)
        gone = (conditions["x"] < -0.99) & (effects.get("bend", 0.0) > 0.0)
        return np.where(gone, np.nan, value)

    found = adopt(replace(problem, model=partly, vault=Vault(np.array([0, 5, 10, 15]))), ["slope"], 1)
    tables = [one.vault_rows for one in found.fits]
    assert len(tables) == 3
    assert all(rows is not None and len(rows.observable) == 3 for rows in tables), "the row at x = -1 is out"
