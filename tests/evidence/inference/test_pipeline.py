"""Decisions of the whole pipeline: not confirmed, seen in one place only, dependent on the seeds."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.data.findings import NONE, OUTSIDE
from taichi_erosion.evidence.data.problem import Budget
from taichi_erosion.evidence.inference import pipeline
from taichi_erosion.evidence.inference.pipeline import (
    analyse,
    confirmed_analysis,
    final_decision,
    initial_decision,
    seed_stability,
)
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, prepare
from taichi_erosion.evidence.inference.verdict import Decision
from tests.evidence.inference.test_refit import jagged
from tests.evidence.linear_study import linear_problem


def test_what_is_not_borne_out_is_not_reported_as_an_explanation(wet):
    posterior = replace(wet.posterior, probability={NONE: 0.0, OUTSIDE: 0.4, "liquid_bridge": 0.6})
    (right,) = [item for item in wet.fitted.refits if item.names == wet.decision.named]
    fitted = replace(wet.fitted, refits=[jagged(wet.fitted.prepared, right, 2.0)])
    decision, final, left = final_decision(fitted, posterior, wet.decision)
    assert decision.verdict == "outside_library"
    assert final is wet.fitted.base
    assert left == wet.p_misfit


def test_a_misfit_in_one_place_is_seen_where_the_whole_hides_it(wet):
    posterior = replace(wet.posterior, probability={NONE: 0.01, OUTSIDE: 0.97, "liquid_bridge": 0.02})
    test = replace(wet.test, p=0.5)
    asked = (wet.fitted, posterior, test)
    assert initial_decision(*asked, p_misfit=0.02).verdict in ("none_detected", "not_testable")
    assert initial_decision(*asked, p_misfit=0.005).verdict == "outside_library"
    assert min(place.p for place in wet.places) < 0.01


def halves(first: dict[str, float], second: dict[str, float], noisy: bool = True):
    """Fitted hypotheses whose posterior depends on which half of eight scoring seeds is used."""

    def rescored(seeds):
        probability = first if seeds[0] == 0 else second
        return SimpleNamespace(posterior=SimpleNamespace(probability=probability))

    seeds = SimpleNamespace(scoring=np.arange(8))
    return SimpleNamespace(prepared=SimpleNamespace(noisy=noisy, seeds=seeds), rescored=rescored)


A, B, NOTHING = {"a": 0.9, "b": 0.1}, {"a": 0.4, "b": 0.6}, {NONE: 0.9, "a": 0.1}


@pytest.mark.parametrize(
    ("first", "second", "share", "verdict"),
    [
        (A, A, 1.0, "present"),
        (A, B, 0.5, "unstable"),  # a half is more than even on another name
        (A, NOTHING, 0.5, "present"),  # a half that sees nothing is weak, not of another opinion
        (A, {"a": 0.3, "b": 0.45, NONE: 0.25}, 0.5, "present"),  # another name leads, but not more than even
        (B, B, 0.0, "unstable"),
    ],
)
def test_a_name_that_changes_with_the_seeds_is_withdrawn(first, second, share, verdict):
    stability, decision = seed_stability(halves(first, second), Decision("present", ("a",)))
    assert (stability, decision.verdict) == (share, verdict)


def test_without_noise_or_without_a_name_nothing_can_be_unstable():
    for asked, decision in (
        (halves(B, B, noisy=False), Decision("present", ("a",))),
        (halves(B, B), Decision("outside_library")),
    ):
        stability, kept = seed_stability(asked, decision)
        assert kept == decision
        assert np.isnan(stability), "no repeat has been made"


SHAPES = {"slope": lambda x: x, "bend": lambda x: x**2, "wave": lambda x: np.sin(4.0 * x)}


def on_budget(name: str, truth: dict[str, float]) -> PreparedProblem:
    """A linear study in whose world some effects act."""
    problem = replace(linear_problem(SHAPES, truth, sd=0.05, seed=4), budget=Budget(name))
    return prepare(problem, problem.measurements, 1)


def test_a_quick_budget_tells_what_a_full_one_tells(monkeypatch):
    def hasty(prepared, seed, progress):
        found = analyse(prepared, seed, progress)
        return replace(found, decision=Decision("present", ("bend",))) if prepared.quick else found

    full = analyse(on_budget("full", {"wave": 1.0}), 1, no_progress)
    monkeypatch.setattr(pipeline, "analyse", hasty)
    quick = on_budget("quick", {"wave": 1.0})
    found = confirmed_analysis(quick, 1, no_progress)
    assert full.decision == Decision("present", ("wave",))
    assert found.decision == full.decision, "not what the quick budget alone would have named"
    assert dict(found.posterior.probability) == dict(full.posterior.probability), "to the bit"
    spent, alone = (each.fitted.prepared.predictor.cost.runs for each in (found, full))
    assert quick.predictor.cost.runs < spent < alone + quick.predictor.cost.runs, "runs are shared"


def test_the_silence_of_a_quick_budget_is_not_asked_again():
    quick = on_budget("quick", {})
    found = confirmed_analysis(quick, 1, no_progress)
    assert not found.decision.accepted
    assert found.fitted.prepared.problem is quick.problem
