"""A listed effect that is stronger than its list allows is named, with its strength."""

from dataclasses import replace

import pytest

from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.data.findings import OUTSIDE
from taichi_erosion.evidence.inference.search import effect_sets
from tests.evidence.linear_study import linear_problem

SHAPES = {"slope": lambda x: x, "bend": lambda x: x**2, "cube": lambda x: x**3}


@pytest.mark.parametrize(("strength", "stronger"), [(4.5, True), (2.5, False)])
def test_an_effect_beyond_the_list_is_named_and_told(strength, stronger):
    problem = linear_problem(SHAPES, {"bend": strength}, sd=0.1)
    found = discover(problem, 1, problem.budget, no_progress)
    assert found.named == ("bend",)
    effect = found.effects["bend"]
    assert effect.stronger_than_list is stronger
    assert effect.strength_low < strength < effect.strength_high
    assert ("stronger than the list allows (up to 3)" in " ".join(found.sentences)) is stronger


def test_a_model_known_from_runs_within_the_list_says_nothing_beyond_it(monkeypatch):
    problem = linear_problem(SHAPES, {"bend": 4.5}, sd=0.1)
    fitted = effect_sets.fit

    def within_the_list(*words, beyond=False):
        return pytest.fail("a fit beyond the list") if beyond else fitted(*words)

    monkeypatch.setattr(effect_sets, "fit", within_the_list)

    def no_error(asked, parameters, effects):
        count = sum(conditions["x"].size for _, conditions in asked)
        return [[0.0] * count] * count

    found = discover(replace(problem, uncertainty=no_error), 1, problem.budget, no_progress)
    assert found.probabilities[OUTSIDE] > 0.5
    assert not any(effect.stronger_than_list for effect in found.effects.values())
