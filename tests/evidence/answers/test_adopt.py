"""Adoption: what the held-out rows say for and against an effect."""

import numpy as np
import pytest

from taichi_erosion.evidence.answers.adopt import on_common_rows
from taichi_erosion.evidence.answers.documents import adoption_sentence
from taichi_erosion.evidence.data.findings import Adoption, HypothesisFit, Rows

NO_ROWS = Rows((), (), {}, *[np.zeros(0)] * 7)


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
    words = adoption_sentence(found)
    assert words.endswith("What was held out does not bear liquid_bridge out.") == told


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
    assert all(list(one.vault_rows.conditions["x"]) == [0.0, 2.0] for one in told[:2])
