"""What the evidence loop says where laboratory, code, range or table are off, in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.evidence.answers.adopt import adopt
from taichi_erosion.evidence.answers.agreement_words import agreement
from taichi_erosion.evidence.answers.compare import compare
from taichi_erosion.evidence.data.findings import NONE
from taichi_erosion.evidence.data.problem import Problem
from taichi_erosion.evidence.inference.verdict_levels import fails
from tests.evidence.heap_study import answer, declared, heap_problem, narrowed

OFFSET = 1.5  # deg, five sd of a row
HIDDEN = (2, 7, 12, 17)  # rows held out: two sets of conditions
SILENT = ("none_detected", "not_testable")


def test_an_offset_of_the_laboratory_is_told_as_a_level_and_along_no_condition():
    found = answer(heap_problem({}, offset=OFFSET))
    assert found.verdict in SILENT
    assert found.probabilities[NONE] > 0.8
    (shift,) = found.levels
    assert (shift.observable, shift.kind) == ("angle", "offset")
    assert shift.low < OFFSET < shift.high
    assert found.sentences[0].startswith("angle: measured is 1.6 deg")
    assert found.sentences[1] == "angle: along diameter, moisture no misfit is seen."
    assert fails(found.p_misfit_stated)
    assert not fails(found.p_misfit)


def test_compare_tells_the_same_level_beside_the_misfit_with_stated_errors():
    found = compare(heap_problem({}, offset=OFFSET))
    assert fails(found.p)
    assert not fails(found.p_levels_free)
    assert [shift.observable for shift in found.levels] == ["angle"]
    assert not any(fails(place.p) for place in found.where)


def test_with_nothing_declared_the_answer_is_that_with_the_declaration():
    problem = heap_problem({"bridge": 0.5}, offset=OFFSET)
    free, stated = answer(problem), answer(declared(problem, OFFSET, 0.05))
    assert (free.verdict, free.named) == (stated.verdict, stated.named) == ("present", ("bridge",))
    assert not fails(free.p_misfit_after)
    one, other = free.effects["bridge"], stated.effects["bridge"]
    assert abs(one.strength - other.strength) < 0.5 * (other.strength_high - other.strength_low)


@pytest.mark.parametrize("factor", [10.0, 60.0])
@pytest.mark.parametrize("acting", [{}, {"bridge": 0.5}], ids=["nothing", "bridge"])
def test_a_column_in_a_wrong_unit_is_told_as_a_factor_and_hides_no_effect(factor, acting):
    found = answer(heap_problem(acting, factor=factor))
    (shift,) = found.levels
    assert (shift.observable, shift.kind) == ("height", "factor")
    assert shift.value == pytest.approx(factor, rel=0.03)
    assert "unit" in shift.sentence
    assert found.named == tuple(acting)


def test_an_effect_without_an_offset_is_not_taken_for_one():
    found = answer(heap_problem({"bridge": 0.5}))
    assert found.named == ("bridge",)
    assert found.levels == ()
    assert found.level_probability < 0.5


def test_a_number_beyond_its_range_is_told_and_no_effect_is_named_in_its_place():
    problem = narrowed(heap_problem({}, friction=0.6), 0.48, 0.53)
    found = answer(problem)
    assert found.verdict == "not_testable"
    assert found.range_suffices
    assert found.named == ()
    assert "The misfit is gone if friction may leave its range" in found.sentences[0]
    assert fails(compare(problem).p), "p does not count the number that cannot move"


def test_a_misfit_of_more_than_three_a_degree_of_freedom_is_never_called_consistent():
    document = {"p": 0.54, "rows_visible": 30, "dof": 30.0, "chi2": 7.6e3, "where": []}
    document |= {"observables": {"angle": {"n": 30}}, "parameters": {}}
    assert agreement(document).startswith("The model does not agree")
    assert agreement(document | {"chi2": 31.0}).startswith("The model is consistent")


def test_silence_on_a_rejected_model_comes_with_its_reason():
    found = answer(heap_problem({}, scatter=2.0))
    assert found.verdict in SILENT
    assert fails(found.p_misfit)
    assert found.sentences[0].startswith("The calibrated model does not agree with the measurements (p = ")
    assert "No detectable effect" not in found.sentences[0]
    assert 1.5 < found.scatter_factor < 2.5
    assert f"A scatter {found.scatter_factor:.2g} times as large as stated" in found.sentences[0]


def with_outlier(problem: Problem, row: int, size: float) -> Problem:
    value = problem.measurements.value.copy()
    value[row] += size
    return replace(problem, measurements=replace(problem.measurements, value=value))


def test_one_bad_row_is_told_with_what_the_others_leave():
    found = answer(with_outlier(heap_problem({}), 3, 3.0))
    assert found.named == ()
    worst = found.worst_row
    assert worst is not None
    assert (worst.observable, worst.conditions["moisture"], worst.conditions["diameter"]) == (
        "angle",
        0.25,
        2.0,
    )
    assert worst.residual_sd == pytest.approx(10.0, abs=2.5)  # 3.0 deg over 0.3 deg, and the row's own noise
    assert not fails(worst.p_without)
    assert "sd above every plausible explanation" in found.sentences[0]
    assert "with errors as stated the likeliest is" in found.sentences[1]


def test_an_effect_that_no_condition_lets_act_has_no_probability():
    found = answer(heap_problem({}))
    assert found.probabilities["flat"] == 0.0
    assert sum(found.probabilities.values()) == pytest.approx(1.0)


def test_two_named_effects_are_adopted_together_and_one_of_them_is_not_refuted_alone():
    problem = heap_problem({"bridge": 0.5, "size": 1.0}, hidden=HIDDEN)
    both, one = adopt(problem, ("size", "bridge"), 1), adopt(problem, ("bridge",), 1, others=("size",))
    assert both.added.effects == ("bridge", "size")
    assert both.added.vault_chi2_per_row < 3.0, "four rows of chi2 1"
    assert both.added.vault_chi2_per_row < 0.1 * both.base.vault_chi2_per_row
    assert both.base.vault_chi2_per_row == pytest.approx(one.base.vault_chi2_per_row), "one value as it was"
    assert one.with_all is not None
    assert one.with_all.vault_chi2_per_row == pytest.approx(both.added.vault_chi2_per_row, rel=0.1)
    assert "With all that was named (bridge and size) it goes to" in one.sentence
    assert "does not bear" not in one.sentence


def test_an_adopted_effect_is_judged_after_the_offset_of_the_laboratory():
    found = adopt(heap_problem({"bridge": 0.5}, offset=OFFSET, hidden=HIDDEN), ("bridge",), 1)
    assert found.added.vault_chi2_per_row < 3.0, "four rows of chi2 1"
    assert found.added.strengths["bridge"].low < 0.5 < found.added.strengths["bridge"].high


def test_residuals_are_those_of_the_misfit():
    """By observable and row by row: residuals after errors that rows share, as in the misfit itself."""
    found = compare(declared(heap_problem({}, offset=OFFSET), 10.0, 0.05))
    parts = sum(each.chi2 for each in found.observables.values())
    assert parts == pytest.approx(found.chi2, rel=0.1)  # the shared errors themselves are the difference
    assert np.abs(found.rows.residual).max() < 4.0


def test_an_effect_beyond_its_maximum_is_told_as_one():
    found = answer(heap_problem({"bridge": 4.0}))  # of 3 at most
    assert found.named == ("bridge",)
    assert found.effects["bridge"].stronger_than_list
    assert found.effects["bridge"].strength_low < 4.0 < found.effects["bridge"].strength_high
    assert any("stronger than the list allows (up to 3)" in sentence for sentence in found.sentences)
