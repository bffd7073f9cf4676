"""Scores of trials: bounds, targets, and the word on an answer."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from doe.trials.metrics import Case, Metric, median, share
from doe.trials.score import TRIALS, groups_of, judged, reduced_metrics
from doe.trials.table import HERE

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
    assert held / 2000 == pytest.approx(1.0 - 2.0 * float(stats.binom.cdf(1, 11, 0.5)), abs=0.015)


def case(truth: dict[str, Any], answer: dict[str, Any], ratio: float = 10.0) -> Case:
    plain = {"verdict": "none_detected", "named": [], "group": [], "seconds": 0.2}
    truth = {"parameters": {}, "understated": 1.0, "outside": ""} | truth
    difficulty = {"ratio": ratio, "separation": None}
    return Case({"truth": truth, "difficulty": difficulty, "answer": plain | answer})


def scored(cases: list[Case]) -> dict[str, Metric]:
    return {metric.name: metric for metric in reduced_metrics(cases)}


def test_false_alarms_are_counted():
    null = {"kind": "null", "effects": {}}
    named = {"verdict": "present", "named": ["gusts"]}
    alarms = scored([case(null, {})] * 3 + [case(null, named)])["nulls: any name"]
    assert (alarms.value, alarms.count, alarms.met) == (0.25, 4, False)


def test_cases_count_by_what_acts():
    known = {
        "single": {"kind": "listed", "name": "gusts", "size": 1.0},
        "pair": {"kind": "pair", "effects": {"gusts": 1.0, "sheltering": 1.0}},
        "four": {"kind": "quadruple", "effects": dict.fromkeys("abcd", 1.0)},
        "unlisted": {"kind": "outside", "effects": {"gusts": 1.0}},
        "mechanism": {"kind": "outside", "name": "drag", "form": "power"},
        "impossible": {"kind": "impossible", "effects": {"gusts": 1.0}},
    }
    assert {kind: case(truth, {}).kind for kind, truth in known.items()} == {kind: kind for kind in known}
    held = {"named": ["gusts"], "verdict": "present", "strengths": {"gusts": [1.1, 0.9, 1.3]}}
    assert case(known["single"], held).intervals("strengths") == [True]


@pytest.mark.parametrize(("told", "first", "few"), [(2, 1.0, 1.0), (4, 1.0, 0.0)])
def test_a_group_of_more_than_three_mechanisms_is_no_answer(told, first, few):
    truth = {"kind": "outside", "name": "drag", "form": "power", "condition": "diameter", "exponent": 0.8}
    answer = {"verdict": "outside_library", "mechanisms": ["drag", "lift", "gustiness", "restitution"][:told]}
    answer |= {"law": "drag", "powers": {"diameter": [-0.7, -1.0, -0.5]}, "vault": [10.0, 1.0, 9.0]}
    found = scored([case(truth, answer)])
    assert found["mechanism, ratio >= 7: told first"].value == first
    assert found["mechanism, ratio >= 7: alone or in a group of at most three"].value == few
    assert found["power laws: exponent in its 90 % interval"].value == 1.0
    assert found["the same, right mechanism first"].value == pytest.approx(0.1)


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
    answer = {"verdict": verdict, "named": named, "group": group}
    assert judged(Case({"truth": truth, "answer": answer})) == word


@pytest.mark.parametrize("table", sorted((HERE / "results").iterdir()), ids=lambda table: table.name)
def test_every_stored_case_can_be_scored(table):
    trial = table.name.partition(".")[0]
    groups = groups_of(trial)
    assert groups
    for cases in groups.values():
        assert any(metric.count for metric in TRIALS[trial](cases))
