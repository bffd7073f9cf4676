"""One misfit level for verdict, text and page; an unknown chance is never a misfit."""

from math import nan

import numpy as np
import pytest

from taichi_erosion.evidence.answers.agreement_words import agreement
from taichi_erosion.evidence.inference.posterior import NONE, OUTSIDE, Posterior
from taichi_erosion.evidence.inference.verdict import detected
from taichi_erosion.evidence.inference.verdict_levels import MISFIT_LEVEL, NONE_LIMIT, fails
from taichi_erosion.report.evidence_page import failures

MEANS = {"observables": {"angle": {"n": 9}}, "parameters": {"friction": {}}}
BELOW, ABOVE = 0.99 * MISFIT_LEVEL, 1.01 * MISFIT_LEVEL


@pytest.mark.parametrize(("p", "missing"), [(BELOW, True), (ABOVE, False)])
def test_verdict_text_and_page_call_the_same_misfit_one(p, missing):
    unlikely = Posterior({NONE: 0.5 * NONE_LIMIT, OUTSIDE: 0.5}, {}, {}, np.ones(1))
    document = {
        "p": p,
        "rows_visible": 9,
        "dof": 8.0,
        "chi2": 20.0,
        "where": [{"p": p, "sentence": "here"}],
    } | MEANS
    assert detected(unlikely, 1.0, p) == missing
    assert agreement(document).startswith("The model does not agree") == missing
    assert failures(document) == (["here"] if missing else [])


def test_a_misfit_in_one_place_is_told_beside_a_whole_that_agrees():
    document = {
        "p": ABOVE,
        "rows_visible": 9,
        "dof": 8.0,
        "chi2": 9.0,
        "where": [{"p": BELOW}, {"p": None}],
    } | MEANS
    assert "as a whole" in agreement(document)
    assert "but not everywhere" in agreement(document)


@pytest.mark.parametrize("unknown", [None, nan])
def test_an_unknown_chance_never_counts_as_a_misfit(unknown):
    document = {"p": 0.5, "rows_visible": 9, "dof": 8.0, "chi2": 9.0, "where": [{"p": unknown}]} | MEANS
    assert not fails(unknown)
    assert failures(document) == []
    assert agreement(document).startswith("The model is consistent with")
