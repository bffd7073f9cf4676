"""A third and a fourth effect must gain more than chance gives the best of all that could be added."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.map_fit import fit
from taichi_erosion.evidence.inference.pipeline import FittedHypotheses, analyse
from taichi_erosion.evidence.inference.prepared_problem import prepare
from taichi_erosion.evidence.inference.refit import FittedHypothesis, scored_fit, total_evidence
from taichi_erosion.evidence.inference.search.effect_sets import member_test, needed_decision
from taichi_erosion.evidence.inference.verdict import Decision
from tests.evidence.inference.search.test_effect_sets import SHAPES, THREE
from tests.evidence.linear_study import linear_problem

DRAWS = np.ones(2000)


def analysed(seed: int) -> FittedHypotheses:
    problem = linear_problem(SHAPES, THREE, sd=0.1, seed=seed)
    return analyse(prepare(problem, problem.measurements, 1), 1, no_progress).fitted


def with_set(fitted: FittedHypotheses, names: tuple[str, ...]) -> FittedHypothesis:
    """A set fitted and put among those that were found."""
    search = fitted.search
    if names not in search.found:
        start = np.concatenate([fitted.base.fit.x, np.full(len(names), 0.5)])
        best = fit(search.prepared, names, [start])
        search.found[names] = scored_fit(search.prepared, best, search.family)
    return search.found[names]


@pytest.fixture(scope="module")
def fitted() -> FittedHypotheses:
    return analysed(3)


def test_every_effect_that_acts_is_needed(fitted):
    search, names = fitted.search, fitted.search.sorted(tuple(THREE))
    for name in names:
        test = member_test(search, search.found[names], name, DRAWS, 1)
        assert test.p == pytest.approx(1.0 / 2001.0)
        assert test.gain > 10.0
        assert test.rest == tuple(other for other in names if other != name)
    decision = Decision("present", names)
    assert needed_decision(search, decision, DRAWS, 1)[0] == decision


def test_the_gain_is_the_ratio_of_the_evidences(fitted):
    search, names = fitted.search, fitted.search.sorted(tuple(THREE))
    test = member_test(search, search.found[names], names[0], DRAWS, 1)
    weight = search.prepared.doubt.log_weight
    both = [log_sum_exp(weight + search.found[each].scored.log_evidence) for each in (names, names[1:])]
    assert test.gain == pytest.approx(float(both[0] - both[1]))


def test_an_effect_that_does_not_act_is_dropped_and_its_test_told(fitted):
    names = fitted.search.sorted((*THREE, "step"))
    with_set(fitted, names)
    decision, tests = needed_decision(fitted.search, Decision("present", names), DRAWS, 1)
    assert decision == Decision("present", fitted.search.sorted(tuple(THREE)))
    told = {test.name: test for test in tests}
    assert not told["step"].needed
    assert all(told[name].needed for name in THREE)


def test_a_group_of_one_beside_sure_effects_is_told_without_it(fitted):
    sure = fitted.search.sorted(tuple(THREE))
    with_set(fitted, fitted.search.sorted((*THREE, "step")))
    group = Decision("group", sure, (*sure, "step"))
    assert needed_decision(fitted.search, group, DRAWS, 1)[0] == Decision("present", sure)


def test_pairs_and_silence_are_not_asked(fitted):
    for decision in (Decision("present", ("bend", "wave")), Decision("none_detected"), Decision("group")):
        assert needed_decision(fitted.search, decision, DRAWS, 1) == (decision, [])


def test_where_the_rest_leaves_a_misfit_one_of_those_that_do_as_well_is_told(fitted, monkeypatch):
    search, sure = fitted.search, fitted.search.sorted(tuple(THREE))
    for other in ("step", "slope"):
        with_set(fitted, search.sorted((*THREE, other)))
    monkeypatch.setattr(
        "taichi_erosion.evidence.inference.search.effect_sets.misfit_p", lambda *_: 0.1 * levels.MISFIT_LEVEL
    )
    named = search.sorted((*THREE, "step"))
    decision, _ = needed_decision(search, Decision("present", named), DRAWS, 1)
    logs = [
        total_evidence(search.prepared, search.found[search.sorted((*THREE, o))]) for o in ("step", "slope")
    ]
    if abs(logs[0] - logs[1]) < levels.MEMBER_BEHIND:
        assert decision.verdict == "group"
        assert decision.named == sure
        assert set(decision.group) == {*THREE, "step", "slope"}
    else:
        assert decision == Decision("present", named)


def test_the_p_of_an_effect_that_does_not_act_is_seldom_small():
    tests = []
    for seed in (10, 11):
        fitted = analysed(seed)
        names = fitted.search.sorted((*THREE, "slope"))
        item = with_set(fitted, names)
        tests.append(member_test(replace(fitted.search), item, "slope", DRAWS, seed))
    assert sum(test.needed for test in tests) == 0
    assert max(test.p for test in tests) > 0.2
