"""What the evidence loop says where laboratory, code, range or table are off, in closed form."""

from dataclasses import replace

import pytest
from taichi_erosion.evidence.answers.adopt import adopt
from taichi_erosion.evidence.answers.compare import compare
from taichi_erosion.evidence.data.findings import NONE
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
    assert fails(found.p_misfit_stated)
    assert not fails(found.p_misfit)


def test_with_nothing_declared_the_answer_is_that_with_the_declaration():
    problem = heap_problem({"bridge": 0.5}, offset=OFFSET)
    free, stated = answer(problem), answer(declared(problem, OFFSET, 0.05))
    assert (free.verdict, free.named) == (stated.verdict, stated.named) == ("present", ("bridge",))
    assert not fails(free.p_misfit_after)
    one, other = free.effects["bridge"], stated.effects["bridge"]
    assert abs(one.strength - other.strength) < 0.5 * (other.strength_high - other.strength_low)


@pytest.mark.parametrize(("factor", "acting"), [(60.0, {}), (10.0, {"bridge": 0.5})])
def test_a_column_in_a_wrong_unit_is_told_as_a_factor_and_hides_no_effect(factor, acting):
    found = answer(heap_problem(acting, factor=factor))
    (shift,) = found.levels
    assert (shift.observable, shift.kind) == ("height", "factor")
    assert shift.value == pytest.approx(factor, rel=0.03)
    assert found.named == tuple(acting)


def test_a_number_beyond_its_range_is_told_and_no_effect_is_named_in_its_place():
    problem = narrowed(heap_problem({}, friction=0.6), 0.48, 0.53)
    found = answer(problem)
    assert found.verdict == "not_testable"
    assert found.range_suffices
    assert found.named == ()
    assert fails(compare(problem).p), "p does not count the number that cannot move"


def test_silence_on_a_rejected_model_comes_with_its_reason():
    found = answer(heap_problem({}, scatter=2.0))
    assert found.verdict in SILENT
    assert fails(found.p_misfit)
    assert 1.5 < found.scatter_factor < 2.5


def test_one_bad_row_is_told_with_what_the_others_leave():
    problem = heap_problem({})
    value = problem.measurements.value.copy()
    value[3] += 3.0
    found = answer(replace(problem, measurements=replace(problem.measurements, value=value)))
    assert found.named == ()
    worst = found.worst_row
    assert worst is not None
    assert worst.observable == "angle"
    assert (worst.conditions["moisture"], worst.conditions["diameter"]) == (0.25, 2.0)
    assert worst.residual_sd == pytest.approx(10.0, abs=2.5)  # 3.0 deg over 0.3 deg, and the row's own noise
    assert not fails(worst.p_without)


def test_an_adopted_effect_is_judged_after_the_offset_of_the_laboratory():
    found = adopt(heap_problem({"bridge": 0.5}, offset=OFFSET, hidden=HIDDEN), ("bridge",), 1)
    assert found.added.vault_chi2_per_row < 3.0, "four rows of chi2 1"
    assert found.added.strengths["bridge"].low < 0.5 < found.added.strengths["bridge"].high
