"""A listed effect that is stronger than its list allows is named, with its strength."""

import pytest

from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
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
