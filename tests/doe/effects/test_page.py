"""The simple scenes of the page of effects, and how their answers are judged."""

from dataclasses import replace
from math import nan, sqrt
from pathlib import Path

import numpy as np
import pytest

from doe.common.tables import read_table
from doe.effects.answers import Answer, pocket_cases
from doe.effects.page import Saying, judged
from doe.effects.pocket import Pocket, expected_threshold, measured_thresholds
from taichi_erosion.effect_library import load_library

TABLES = Path(__file__).parents[3] / "doe" / "effects"
BARE = Pocket()
SAYING = Saying("dry_adhesion", "lifts", "x", "answers", "u*_t over bare", "", nan, nan, nan, 1)
ANSWER = Answer("dry_adhesion", "u*_t over bare", "diameter [mm]", 0.1, 0.25, 1.5, 0.001, 1.501, 1, "pocket")
SHIFT = {"effect": "dry_adhesion", "label": "", "observable": "pile_height", "unit": "m", "bare": "0.5"}
SHIFT |= {"shift": "0.1", "standard_error": "0.02", "note": ""}


def test_drag_at_the_balance_of_a_bare_grain_is_its_weight_over_two_roots_of_two():
    from tests.verification.reference.flow import Stream, two_limits

    slip = expected_threshold(BARE) ** 2 * 0.5 * BARE.diameter / 1.46e-5
    drag = two_limits(Stream(slip, BARE.diameter, 1.225, 1.225 * 1.46e-5))
    weight = np.pi / 6.0 * BARE.diameter**3 * (BARE.density - 1.225) * 9.81
    assert drag == pytest.approx(weight / (2.0 * sqrt(2.0)), rel=1e-4)
    # shelter raises the balance by just its factor
    between = replace(BARE, effect="drag_partition", conditions=(("roughness_density", 0.02),))
    ratio = expected_threshold(between) / expected_threshold(BARE)
    # the two factors of the page for m = 0.5, s = 1, b = 100
    assert ratio == pytest.approx(sqrt(0.99 * 2.0), rel=1e-5)


def test_every_effect_of_the_library_has_a_sentence_to_be_held_to():
    assert {saying.effect for saying in read_table(TABLES / "literature.csv", Saying)} == set(load_library())


@pytest.mark.parametrize(
    ("answer", "saying", "kept"),
    [
        (ANSWER, SAYING, "yes"),
        (replace(ANSWER, value=1.45), SAYING, "no"),  # 3.4 % from its answer
        (replace(ANSWER, value=0.9, expected=0.9), SAYING, "no"),  # the wrong way
        (replace(ANSWER, law=1.2), SAYING, "in sign"),
        (replace(ANSWER, law=1.4), SAYING, "yes"),
        (ANSWER, replace(SAYING, low=1.0, high=1.1), "in sign"),
        (ANSWER, replace(SAYING, low=1.0, high=1.1, sign=0), "no"),
        (ANSWER, replace(SAYING, place=0.5), "open"),
        (ANSWER, replace(SAYING, table=""), "open"),
    ],
)
def test_an_answer_is_judged_by_way_by_nearness_and_by_law(answer, saying, kept):
    assert judged(saying, [answer], [], []).kept == kept


@pytest.mark.parametrize(
    ("shift", "sign", "kept"),
    [("0.1", 1, "yes"), ("0.1", -1, "no"), ("0.03", 1, "not significant"), ("nan", 1, "open")],
)
def test_a_shift_within_two_standard_errors_is_not_told(shift, sign, kept):
    saying = replace(SAYING, table="shifts", quantity="pile_height", sign=sign)
    assert judged(saying, [], [SHIFT | {"shift": shift}], []).kept == kept


@pytest.mark.slow
def test_grains_leave_their_pockets_where_their_forces_balance():
    cases = [BARE, *(case for _, _, case in pocket_cases() if case.diameter == BARE.diameter)]
    measured = measured_thresholds(cases)
    # 0.12 % of the bisection, and contacts that yield; an adhesion of short range is shaken off 1 % earlier
    assert measured == pytest.approx([expected_threshold(case) for case in cases], rel=0.015)
