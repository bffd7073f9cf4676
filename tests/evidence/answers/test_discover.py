"""Discovery on closed-form studies whose truth is known."""

from dataclasses import replace

from doe.trials.reduced.clean import Case, draw_case
from doe.trials.reduced.laboratory import CaseModel
from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from tests.evidence.linear_study import linear_problem

FAMILY = 5000


def without_scatter(case: Case) -> Case:
    model = case.problem.model
    assert isinstance(model, CaseModel)
    return replace(case, problem=replace(case.problem, model=CaseModel(0.0, 0.0, model.aliases)))


SINGLES = [c for c in (draw_case(FAMILY, number) for number in range(40)) if c.truth.kind == "single"]


def test_an_absent_strong_effect_is_excluded_down_to_a_small_strength():
    case = without_scatter(next(case for case in SINGLES if case.truth.understated == 1.0))
    found = discover(case.problem, 1, case.problem.budget, no_progress)
    bounds = {
        name: effect.strength_high * effect.signature_norm
        for name, effect in found.effects.items()
        if effect.status == "excluded" and effect.signature_norm > 30.0
    }
    assert bounds
    # 95 % of a half-normal likelihood of unit sd lie below 2; a chance pull of 2 sd doubles that
    assert all(bound < 4.5 for bound in bounds.values())


def test_an_effect_that_the_measurements_favour_is_not_told_as_excluded():
    shapes = {"bend": lambda x: x**2, "slope": lambda x: x, "cube": lambda x: x**3 - 0.6 * x}
    problem = linear_problem(shapes, {"bend": 0.5}, sd=0.4, count=48, seed=4)
    found = discover(problem, 1, problem.budget, no_progress)
    bend, slope = found.effects["bend"], found.effects["slope"]
    assert found.verdict == "none_detected"
    assert bend.power > 0.8
    assert bend.strength_high < 1.0
    assert bend.log_bayes_factor > 1.1
    assert bend.status == "not_testable"
    assert bend.sentence.startswith("bend: not excluded: strengths up to")
    assert found.probabilities["bend"] > found.probabilities["none"]
    assert found.sentences[0].startswith("No effect is named. Excluded: slope above")
    assert f"Not excluded: bend up to {bend.strength_high:.2g}." in found.sentences[0]
    assert slope.log_bayes_factor < 0.0
    assert slope.status == "excluded"
