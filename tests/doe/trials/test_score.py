"""Scores of trials: bounds, targets, and the word on an answer."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from doe.trials.metrics import Case, median, share
from doe.trials.score import TRIALS, beyond_metrics, clean_metrics, groups_of, judged, paired_difference

WATER, ROLLING = "liquid_bridge", "rolling_resistance"
UNLISTED = "restitution that falls with moisture"


def test_a_target_counts_as_met_by_its_bound():
    assert not share("m", [False] * 100, "<= 0.02").met, "100 silent nulls leave room for 3.6 %"
    assert share("m", [False] * 200, "<= 0.02").met


def test_bounds_of_a_median_hold_it_as_often_as_they_say():
    generator, held = np.random.default_rng(3), 0
    for _ in range(2000):
        found = median("m", generator.standard_normal(11).tolist())
        held += found.low <= 0.0 <= found.high
    exact = 1.0 - 2.0 * float(stats.binom.cdf(1, 11, 0.5))
    assert held / 2000 == pytest.approx(exact, abs=0.015)


def test_the_bounds_of_a_paired_difference_exclude_zero_where_the_exact_test_rejects():
    for first, second in ((12, 3), (9, 4), (20, 5), (6, 0)):
        found = paired_difference("d", first, second, 100)
        assert found.value == pytest.approx((first - second) / 100)
        assert found.low < found.value <= found.high
        rejected = stats.binomtest(first, first + second).pvalue < 0.05
        assert (found.low > 0.0) == rejected
    assert paired_difference("d", 0, 0, 50).value == 0.0


def null(named: list[str], **row: Any) -> Case:
    truth = {"kind": "null", "effects": {}, "parameters": {}, "understated": 1.0, "outside": ""}
    verdict, likely = ("present", {"none": 0.1, "gusts": 0.9}) if named else ("none_detected", {"none": 0.8})
    answer = {"verdict": verdict, "named": named, "group": [], "probabilities": likely, "seconds": 0.2}
    answer |= {"strengths": {}, "parameters": {}, "vault": [None] * 3}
    return Case({"truth": truth, "difficulty": {"ratio": 0.0, "separation": None}, "answer": answer, **row})


def test_false_alarms_are_counted_and_further_cases_are_not():
    cases = [null([]), null([]), null([]), null(["gusts"]), null(["gusts"], further=True)]
    alarms = next(clean_metrics(cases))
    assert (alarms.value, alarms.count, alarms.met) == (0.25, 4, False)


def test_gain_and_offset_of_one_instrument_count_as_one_member_of_a_group():
    law = {"exponents": {"diameter": {"low": -1.0, "high": -0.5}}}
    truth = {"kind": "outside", "name": "drag", "form": "power", "condition": "diameter", "exponent": 0.8}
    told = ["drag", "lift", "reading_gain:flux", "reading_offset:flux"]
    answer = {"verdict": "outside_library", "named": [], "seconds": 1.0, "mechanisms": told, "law": law}
    answer |= {"beyond": "group", "held_out": [10.0, 1.0]}
    case = Case({"truth": truth, "difficulty": {"ratio": 10.0}, "answer": answer})
    found = {metric.name: metric.value for metric in beyond_metrics([case])}
    assert found["outside, ratio >= 7: mechanism told, alone or in a group of at most three"] == 1.0
    assert found["power laws, mechanism right: exponent in its 90 % interval"] == 1.0


@pytest.mark.parametrize(
    ("effects", "outside", "verdict", "named", "group", "word"),
    [
        ((), "", "none_detected", (), (), "right"),
        ((), "", "present", (WATER,), (), "false alarm"),
        ((), "", "outside_library", (), (), "false alarm"),
        ((WATER,), "", "present", (WATER,), (), "right"),
        ((WATER,), "", "group", (), (WATER, ROLLING), "in the group"),
        ((WATER,), "", "present", (WATER, ROLLING), (), "partly"),
        ((WATER,), "", "present", (ROLLING,), (), "wrong"),
        ((WATER,), "", "outside_library", (), (), "wrong"),
        ((WATER,), "", "none_detected", (), (), "silent"),
        ((WATER, ROLLING), "", "present", (WATER,), (), "partly"),
        ((WATER, ROLLING), "", "group", (WATER,), (ROLLING, "dry_adhesion"), "in the group"),
        ((), UNLISTED, "outside_library", (), (), "right"),
        ((), UNLISTED, "none_detected", (), (), "silent"),
        ((), UNLISTED, "present", (WATER,), (), "wrong"),
    ],
)
def test_a_group_or_a_superset_is_not_the_exact_name(effects, outside, verdict, named, group, word):
    truth = {"effects": dict.fromkeys(effects, 1.0), "outside": outside}
    assert (
        judged(Case({"truth": truth, "answer": {"verdict": verdict, "named": named, "group": group}})) == word
    )


@pytest.mark.parametrize("trial", TRIALS)
def test_every_stored_case_can_be_scored(trial):
    groups = groups_of(trial)
    assert groups
    for cases in groups.values():
        assert any(metric.count for metric in TRIALS[trial](cases))
