"""What a refit says: fits no worse than the truth, and what the measurements reject names nothing."""

from dataclasses import replace

import numpy as np
import pytest

from doe.trials.reduced.clean import Case, draw_case
from doe.trials.reduced.laboratory import CaseModel
from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.data.findings import OUTSIDE
from taichi_erosion.evidence.data.transforms import position_of
from taichi_erosion.evidence.inference.map_fit import GOOD_ENOUGH, Objective, fit_base
from taichi_erosion.evidence.inference.marginal_likelihood import expand
from taichi_erosion.evidence.inference.model_discrepancy import NO_KERNELS
from taichi_erosion.evidence.inference.posterior import posterior_of
from taichi_erosion.evidence.inference.prepared_problem import prepare
from taichi_erosion.evidence.inference.refit import (
    FittedHypothesis,
    fit_from_other_starts,
    fit_singles,
    hypotheses,
    mean_misfit_p,
    misleading,
)
from taichi_erosion.evidence.inference.screen import screen
from taichi_erosion.evidence.inference.verdict_levels import REJECTION_LEVEL
from tests.evidence.linear_study import linear_problem

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
    prepared, best, _ = fit_base(prepared)
    screened = screen(prepared, expand(prepared, best))
    (name,) = case.truth.effects
    (refitted,) = fit_singles(prepared, screened, [name], NO_KERNELS, no_progress)[:1]
    objective = Objective(prepared, (name,), prepared.seeds.fitting)
    truth = np.append(position_of(prepared.axes, case.truth.parameters, {}), case.truth.effects[name])
    assert refitted.names == (name,)
    assert refitted.fit.misfit <= objective.misfit(truth, objective.residual(truth)) + GOOD_ENOUGH


def jagged(prepared, item: FittedHypothesis, size: float) -> FittedHypothesis:
    """The hypothesis with a mean that no smooth effect could have."""
    change = size * prepared.sd * np.where(np.arange(prepared.sd.size) % 2, 1.0, -1.0)
    moved = replace(item.expansion, mean=item.expansion.mean + change)
    return replace(item, scored=replace(item.scored, expansion=moved))


def test_what_the_measurements_reject_counts_as_something_not_in_the_list(wet):
    prepared = wet.fitted.prepared
    (right,) = [item for item in wet.fitted.refits if item.names == wet.decision.named]
    assert mean_misfit_p(prepared, right) > REJECTION_LEVEL
    wrong = jagged(prepared, right, 40.0)
    assert mean_misfit_p(prepared, wrong) < REJECTION_LEVEL
    others = [item for item in wet.fitted.refits if not set(right.names) & set(item.names)]
    listed = hypotheses(prepared, wet.fitted.base, wet.fitted.screened, wet.test, [*others, wrong])
    assert [h.rejected for h in listed if h.names == right.names] == [True, True]
    posterior = posterior_of(prepared, listed)
    assert posterior.inclusion["liquid_bridge"] < 0.01 < 0.5 < posterior.probability[OUTSIDE]


def test_where_every_single_exceeds_its_maximum_the_others_start_from_the_bare_model():
    problem = linear_problem({"slope": lambda x: x, "bend": lambda x: x**2}, {"bend": 1.0}, sd=0.05)
    prepared, best, _ = fit_base(prepare(problem, problem.measurements, 1))
    screened = screen(prepared, expand(prepared, best))
    (item,) = fit_singles(prepared, screened, ["bend"], NO_KERNELS, no_progress)
    stronger = replace(item.scored.expansion, fit=replace(item.fit, beyond=True))
    beyond = replace(item, scored=replace(item.scored, expansion=stronger))
    found = fit_from_other_starts(prepared, screened, [beyond], NO_KERNELS, no_progress)
    assert {each.names[0] for each in found} == {"slope", "bend"}
    assert not any(each.fit.beyond for each in found)


def test_a_screen_misleads_where_a_refit_takes_away_another_misfit_than_it_told():
    problem = linear_problem({"slope": lambda x: x, "bend": lambda x: x**2}, {"bend": 1.0}, sd=0.05)
    prepared, best, _ = fit_base(prepare(problem, problem.measurements, 1))
    screened = screen(prepared, expand(prepared, best))
    (item,) = fit_singles(prepared, screened, ["bend"], NO_KERNELS, no_progress)
    assert not misleading(screened, [item]), "the model is linear in the strength"
    worse = replace(item.fit, misfit=item.fit.misfit + 40.0)
    scored = replace(item.scored, expansion=replace(item.expansion, fit=worse))
    assert misleading(screened, [FittedHypothesis(scored, item.gain)])


def test_after_a_misleading_screen_an_effect_that_it_dismissed_is_weighed(monkeypatch):
    problem = linear_problem({"slope": lambda x: x, "bend": lambda x: x**2}, {"bend": 1.0}, sd=0.05)
    prepared, best, _ = fit_base(prepare(problem, problem.measurements, 1))
    screened = screen(prepared, expand(prepared, best))
    for misled, names in ((False, {"slope"}), (True, {"slope", "bend"})):
        monkeypatch.setattr("taichi_erosion.evidence.inference.refit.misleading", lambda *_, m=misled: m)
        monkeypatch.setattr("taichi_erosion.evidence.inference.refit.none_fits", lambda *_: False)
        found = fit_singles(prepared, screened, ["slope"], NO_KERNELS, no_progress)
        assert {item.names[0] for item in found} == names
