"""Discovery on closed-form studies whose truth is known."""

from dataclasses import replace

from doe.sealed.cases import Case, draw_case
from doe.sealed.laboratory import CaseModel
from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover

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
