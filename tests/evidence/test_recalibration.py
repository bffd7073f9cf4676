"""Calibration and the search for effects on closed-form studies whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest

from doe.sealed.cases import Case, draw_case
from doe.sealed.laboratory import CaseModel
from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.data.transforms import position_of
from taichi_erosion.evidence.inference.map_fit import GOOD_ENOUGH, Objective, fit_base, misfit_of
from taichi_erosion.evidence.inference.marginal_likelihood import expand
from taichi_erosion.evidence.inference.prepared_problem import prepare
from taichi_erosion.evidence.inference.refit import fit_singles
from taichi_erosion.evidence.inference.screen import screen

FAMILY = 5000


def without_scatter(case: Case) -> Case:
    model = case.problem.model
    assert isinstance(model, CaseModel)
    return replace(case, problem=replace(case.problem, model=CaseModel(0.0, 0.0, model.aliases)))


SINGLES = [c for c in (draw_case(FAMILY, number) for number in range(40)) if c.truth.kind == "single"]


@pytest.mark.parametrize(
    "case", [without_scatter(case) for case in SINGLES[:6]], ids=lambda case: str(case.number)
)
def test_a_recalibration_with_the_true_effect_is_no_worse_than_the_truth(case):
    prepared = prepare(case.problem, case.problem.visible(), 1)
    prepared, fitted, _ = fit_base(prepared)
    found = screen(prepared, expand(prepared, fitted))
    (name,) = case.truth.effects
    (judged,) = fit_singles(prepared, found, [name], [], no_progress)[:1]
    objective = Objective(prepared, (name,), prepared.seeds.fitting)
    truth = np.append(position_of(prepared.axes, case.truth.parameters, {}), case.truth.effects[name])
    assert judged.names == (name,)
    at_truth = misfit_of(objective, truth, objective.residual(truth))
    assert judged.scored.expansion.fit.misfit <= at_truth + GOOD_ENOUGH


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
