"""Adoption: what the held-out rows say for and against an effect."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.evidence.answers.adopt import adopt, judged, on_common_rows
from taichi_erosion.evidence.answers.documents import adoption_sentence
from taichi_erosion.evidence.data.findings import Adoption, HypothesisFit, Rows
from taichi_erosion.evidence.data.problem import Vault
from tests.evidence.linear_study import LEVEL_SD, linear_problem

NO_ROWS = Rows((), (), {}, *[np.zeros(0)] * 7, limit=())


def fit(chi2: float, *effects: str, rows: Rows | None = None) -> HypothesisFit:
    return HypothesisFit(effects, {}, {}, 40.0, chi2, {}, NO_ROWS, rows)


def table(*residual: float) -> Rows:
    column = np.array(residual)
    return Rows(
        ("angle",) * 3,
        ("g",) * 3,
        {"x": np.arange(3.0)},
        column,
        column,
        0.0 * column,
        column,
        column,
        column,
        column,
    )


@pytest.mark.parametrize(
    ("before", "after", "told"), [(40.0, 38.0, True), (40.0, 4.0, False), (1.4, 1.3, False)]
)
def test_adopting_says_where_the_held_out_rows_contradict_the_name(before, after, told):
    found = Adoption(effect="liquid_bridge", base=fit(before), added=fit(after, "liquid_bridge"))
    assert judged(found).contradicted == told
    words = judged(found).sentence
    assert words.endswith("What was held out does not bear liquid_bridge out.") == told


def test_an_error_that_does_not_fall_contradicts_whatever_its_size():
    found = Adoption(effect="gusts", base=fit(1.2), added=fit(1.3, "gusts"))
    assert judged(found).contradicted


@pytest.mark.parametrize(
    ("chance", "words"), [(0.4, "show no misfit (p = 0.4)"), (1e-9, "is not adequate there")]
)
def test_held_out_rows_say_whether_the_adopted_model_is_adequate(chance, words):
    added = replace(fit(2.0, "gusts"), vault_p=chance)
    assert words in adoption_sentence(Adoption(effect="gusts", base=fit(9.0), added=added))


def test_a_control_that_does_as_well_is_told():
    rows = table(1.0, 2.0, 3.0)
    added, near, far = fit(1.5, "gusts", rows=rows), fit(2.4, "bed_slope"), fit(2.6, "sheltering")
    found = Adoption(effect="gusts", base=fit(9.0), added=added, best_wrong=near, random_wrong=far)
    # three rows: a difference of 3 in all is one of 1 per row
    assert "bed_slope does as well there" in adoption_sentence(found)
    assert "sheltering and bed_slope" not in adoption_sentence(found)


def test_the_chance_of_held_out_rows_is_that_of_a_normal_with_what_calibration_leaves_open():
    problem = linear_problem({"slope": lambda x: x}, {"slope": 1.0}, sd=0.1, seed=2)
    held = np.arange(0, 24, 3)
    found = adopt(replace(problem, vault=Vault(held)), ["slope"], 1)
    x, z = problem.measurements.conditions["x"], problem.measurements.value
    seen = np.setdiff1d(np.arange(24), held)
    design = np.column_stack([x, np.ones(24)])
    prior = np.diag([0.0, LEVEL_SD**-2])
    covariance = np.linalg.inv(design[seen].T @ design[seen] / 0.01 + prior)
    gap = z[held] - design[held] @ covariance @ design[seen].T @ z[seen] / 0.01
    whole = np.eye(held.size) + design[held] @ covariance @ design[held].T / 0.01
    drawn = np.random.default_rng(0).standard_normal((20000, held.size)) @ np.linalg.cholesky(whole).T
    exact = np.mean(np.sum(drawn**2, axis=1) > np.sum(gap**2) / 0.01)
    # the strength's prior of 1.5 moves its best value by a thousandth; 20,000 draws know p to 0.004
    assert found.added.vault_p == pytest.approx(exact, abs=0.03)
    assert found.base.vault_p < 1e-6


def test_controls_and_missing_values_are_told_and_an_empty_vault_proves_nothing():
    added = fit(4.0, "liquid_bridge")
    bare = fit(40.0, rows=table(1.0, 2.0, 3.0))
    found = Adoption(
        effect="liquid_bridge", base=bare, added=added, best_wrong=fit(39.0, "gusts"), held_out=5
    )
    assert "for comparison 39 with the best other candidate (gusts)." in adoption_sentence(found)
    assert adoption_sentence(found).endswith("For 2 of 5 held-out rows there is no value.")
    empty = Adoption(effect="liquid_bridge", base=fit(np.nan), added=fit(np.nan, "liquid_bridge"))
    assert adoption_sentence(empty).endswith("no row was held out, so nothing is proved.")


def test_all_hypotheses_are_held_against_the_rows_that_each_has_a_value_for():
    fits = [fit(np.nan, rows=table(1.0, np.nan, 3.0)), fit(np.nan, rows=table(2.0, 9.0, 2.0)), None]
    told = on_common_rows(fits)
    assert told[2] is None
    assert [one.vault_chi2 for one in told if one is not None] == [5.0, 4.0]
    tables = [one.vault_rows for one in told if one is not None]
    assert all(rows is not None and list(rows.conditions["x"]) == [0.0, 2.0] for rows in tables)
