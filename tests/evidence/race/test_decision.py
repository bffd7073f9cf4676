"""The decision under other priors: rescored explanations beside whole races with these priors."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from doe.trials.reduced.families import FAMILIES
from taichi_erosion.evidence.race.decision import ERRORS, any_acts, decide_cause, reweight_priors, sensitivity
from taichi_erosion.evidence.race.fit import OUTSIDE, Hypothesis
from taichi_erosion.evidence.race.posterior import Posterior, infer
from taichi_erosion.evidence.race.priors import PRIORS, Priors

CASE = (7, "several", 3)


@cache
def race_under(priors: Priors) -> Posterior:
    number, family, seed = CASE
    return infer(FAMILIES[family](seed, number).problem, number, priors=priors)


def shares(posterior: Posterior) -> list[float]:
    names = posterior.race.model.candidates
    return [*(any_acts(posterior, [name]) for name in names), any_acts(posterior, [OUTSIDE])]


@pytest.mark.parametrize("names", [("typical",), ERRORS, ("step",), ("unlisted",)])
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_explanations_that_are_solved_anew_have_the_shares_of_a_whole_race(names, factor):
    priors = replace(PRIORS, **{name: factor * getattr(PRIORS, name) for name in names})
    usual = race_under(PRIORS)
    found, whole = shares(reweight_priors(usual, priors)), shares(race_under(priors))
    assert found == pytest.approx(whole, abs=0.03)  # which also searches anew
    assert reweight_priors(usual, PRIORS).probability == pytest.approx(usual.probability, abs=1e-12)


def test_odds_that_are_doubled_double_the_odds():
    usual = race_under(PRIORS)
    rescored = [there for key, there, _ in sensitivity(usual, decide_cause(usual)) if key == "nothing"]
    nothing = [each.probability[Hypothesis(())] for each in (usual, *rescored)]
    odds = [p / (1.0 - p) for p in nothing]
    assert odds[1] < 0.6 * odds[0]
    assert odds[2] > 1.7 * odds[0]


def test_what_is_told_after_fresh_runs_stands_where_the_race_decides_alike():
    usual = race_under(PRIORS)
    told = replace(decide_cause(usual), verdict="group", group=("a", "b"))
    found = [decision.decision_record for _, _, decision in sensitivity(usual, told)]
    moved = [each for each in found if each.group != ("a", "b")]
    assert len(found) == 10
    assert len(moved) < len(found)
    assert all(sum(each.probabilities.values()) == pytest.approx(1.0) for each in found)


def test_the_page_states_the_priors_that_are_used():
    page = (Path(__file__).parents[3] / "docs" / "how_an_answer_is_computed.md").read_text("utf-8")
    p = PRIORS
    stated = [f"half-Cauchy {p.near:g}", f"half-Cauchy {p.large:g}", f"half-normal {p.small:g}"]
    stated += [f"half-normal {2.0 * p.near:g}", f"sd {p.doubt:g}", f"logarithm {p.spread:g}"]
    stated += [f"| {p.nothing:g} |", f"{p.unlisted:g} · {1.0 - p.step:g} · {p.step:g}^k"]
    assert [each for each in stated if each not in page.replace("\n  ", " ")] == []
