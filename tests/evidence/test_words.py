"""What a discovery says in sentences."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.evidence.answers.adopt import adoption_sentence, on_common_rows
from taichi_erosion.evidence.answers.commands import opened
from taichi_erosion.evidence.answers.discover import discovery_of
from taichi_erosion.evidence.data.findings import HypothesisFit, Rows
from taichi_erosion.evidence.data.problem import Observable
from taichi_erosion.evidence.data.transforms import from_scale, to_scale
from taichi_erosion.evidence.inference.goodness_of_fit import axis_words
from taichi_erosion.evidence.inference.levels import REJECTION_LEVEL
from taichi_erosion.evidence.inference.pipeline import Analysis, analyse, final_decision, initial_decision
from taichi_erosion.evidence.inference.posterior import NONE, OUTSIDE, posterior
from taichi_erosion.evidence.inference.prepared_problem import prepare
from taichi_erosion.evidence.inference.refit import hypotheses, mean_misfit_p
from taichi_erosion.evidence.inference.verdict import adequate_decision
from tests.evidence.small_study import write_study

FAILS = "Even with liquid_bridge the model fails"
NO_ROWS = Rows((), (), {}, *[np.zeros(0)] * 5)
SEED = 1


@pytest.fixture(scope="module")
def wet(tmp_path_factory) -> Analysis:
    """A study in whose world liquid bridges act."""
    with opened(write_study(tmp_path_factory.mktemp("wet"), {"liquid_bridge": 1.0})) as study:
        return analyse(prepare(study.problem, study.problem.visible(), SEED), SEED, lambda stage, share: None)


def test_a_name_that_describes_the_measurements_stands_without_a_warning(wet):
    assert wet.decision.named == ("liquid_bridge",)
    assert wet.p_misfit < 1e-6 < 0.01 < wet.p_misfit_after
    assert not any(FAILS in sentence for sentence in discovery_of(wet, SEED, 0.0).sentences)


def test_a_name_that_leaves_a_misfit_is_told_with_it(wet):
    left = discovery_of(replace(wet, p_misfit_after=1e-4), SEED, 0.0)
    assert left.p_misfit_after == 1e-4
    assert left.sentences[1].startswith(f"{FAILS} (p = 0.0001)")


def test_without_a_name_there_is_nothing_that_could_fail(wet):
    bare = discovery_of(replace(wet, final=wet.base, p_misfit_after=1e-4), SEED, 0.0)
    assert not any("Even with" in sentence for sentence in bare.sentences)


def test_an_axis_of_few_values_is_told_by_the_value_where_the_model_fails():
    column = np.repeat([1.0, 2.0, 4.0, 8.0], 4)
    free = np.where(column == 2.0, 3.0, 0.0)
    assert axis_words(column, free) == "too low at {axis} = 2"


def test_a_flux_of_which_only_rounding_is_left_is_none():
    flux = Observable("flux", "log_floor", floor=2e-4)
    assert from_scale(flux, to_scale(flux, np.array([0.0, 1e-12]))) == pytest.approx([0.0, 1e-12], rel=1e-3)
    assert np.all(from_scale(flux, np.log([2e-4 * (1.0 - 1e-15)])) == 0.0)


@pytest.mark.parametrize(
    ("before", "after", "told"), [(40.0, 38.0, True), (40.0, 4.0, False), (1.4, 1.3, False)]
)
def test_adopting_says_where_the_held_out_rows_contradict_the_name(before, after, told):
    bare = HypothesisFit((), {}, {}, 40.0, before, {}, NO_ROWS, None)
    added = replace(bare, effects=("liquid_bridge",), vault_chi2=after)
    words = adoption_sentence("liquid_bridge", bare, added, None, None)
    assert words.endswith("What was held out does not bear liquid_bridge out.") == told


def test_all_hypotheses_are_held_against_the_rows_that_each_has_a_value_for():
    def fit(*residual: float) -> HypothesisFit:
        column = np.array(residual)
        rows = Rows(
            ("angle",) * 3, ("g",) * 3, {"x": np.arange(3.0)}, column, column, 0.0 * column, column, column
        )
        return HypothesisFit((), {}, {}, 1.0, np.nan, {}, NO_ROWS, rows)

    told = on_common_rows([fit(1.0, np.nan, 3.0), fit(2.0, 9.0, 2.0), None])
    assert told[2] is None
    assert [one.vault_chi2 for one in told if one is not None] == [5.0, 4.0]
    assert all(list(one.vault_rows.conditions["x"]) == [0.0, 2.0] for one in told[:2])


def test_what_the_measurements_reject_counts_as_something_not_in_the_list(wet):
    (right,) = [item for item in wet.judged if item.names == wet.decision.named]
    assert mean_misfit_p(wet.prepared, right) > REJECTION_LEVEL
    jagged = 40.0 * wet.prepared.sd * np.where(np.arange(wet.prepared.sd.size) % 2, 1.0, -1.0)
    moved = replace(right.scored.expansion, mean=right.scored.expansion.mean + jagged)
    wrong = replace(right, scored=replace(right.scored, expansion=moved))
    assert mean_misfit_p(wet.prepared, wrong) < REJECTION_LEVEL
    others = [item for item in wet.judged if item is not right]
    told = hypotheses(wet.prepared, wet.base, wet.found, wet.seen, [*others, wrong])
    assert [h.told for h in told if h.names == right.names] == [False, False]
    believed = posterior(wet.prepared, told)
    assert believed.inclusion["liquid_bridge"] < 0.01 < 0.5 < believed.probability[OUTSIDE]


@pytest.mark.parametrize(
    ("outside", "left", "verdict"),
    [
        (0.38, 1.5e-3, "outside_library"),  # an effect that another one imitates
        (0.38, 0.2, "present"),  # nothing is left that would ask for another
        (0.05, 1.5e-3, "present"),  # the scatter is understated, or a second effect is small
    ],
)
def test_a_name_that_leaves_a_misfit_must_be_likelier_than_something_unlisted(wet, outside, left, verdict):
    probability = {NONE: 0.0, OUTSIDE: outside, "liquid_bridge": 1.0 - outside}
    initial_decision = adequate_decision(wet.decision, replace(wet.believed, probability=probability), left)
    assert initial_decision.verdict == verdict
    assert initial_decision.named == (() if verdict == "outside_library" else ("liquid_bridge",))


def test_what_is_not_borne_out_is_not_reported_as_an_explanation(wet):
    believed = replace(wet.believed, probability={NONE: 0.0, OUTSIDE: 0.4, "liquid_bridge": 0.6})
    (right,) = [item for item in wet.judged if item.names == wet.decision.named]
    jagged = 2.0 * wet.prepared.sd * np.where(np.arange(wet.prepared.sd.size) % 2, 1.0, -1.0)
    moved = replace(right.scored.expansion, mean=right.scored.expansion.mean + jagged)
    wrong = replace(right, scored=replace(right.scored, expansion=moved))
    initial_decision, final, left = final_decision(wet.prepared, wet.base, [wrong], believed, wet.decision)
    assert initial_decision.verdict == "outside_library"
    assert final is wet.base
    assert left == wet.p_misfit


def test_a_misfit_in_one_place_is_seen_where_the_whole_hides_it(wet):
    probability = {NONE: 0.01, OUTSIDE: 0.97, "liquid_bridge": 0.02}
    believed = replace(wet.believed, probability=probability)
    seen = replace(wet.seen, p=0.5)
    asked = (wet.prepared, wet.found, wet.judged, believed, seen)
    assert initial_decision(*asked, p_misfit=0.02).verdict in ("none_detected", "not_testable")
    assert initial_decision(*asked, p_misfit=0.005).verdict == "outside_library"
    assert min(place.p for place in wet.where) < 0.01
