"""What is said where laboratory, code, range or table are off, in closed form."""

import numpy as np
import pytest

from taichi_erosion.evidence.answers.commands import adopt_record
from taichi_erosion.evidence.race.posterior import raced
from taichi_erosion.evidence.words.answer_lines import discover_answer
from tests.evidence.heap_study import TRUE_FRICTION, answer, heap_problem, narrowed
from tests.evidence.ten_records import VOC

OFFSET = 1.5  # deg, five sd of a row
HIDDEN = (2, 7, 12, 17)  # rows held out: two sets of conditions


def test_an_offset_of_the_laboratory_is_told_as_a_level_and_along_no_condition():
    found = answer(heap_problem({}, offset=OFFSET))
    assert found.decided.verdict == "none_detected"
    assert found.decided.probabilities["none"] > 0.8
    (shift,) = found.levels
    assert (shift.observable, shift.kind) == ("angle", "offset")
    assert shift.size.low < OFFSET < shift.size.high
    assert found.fit.p_before < 0.01, "calibration alone does not explain it"
    lines = discover_answer(found, VOC).lines
    assert lines[0].startswith("No missing effect is seen")
    assert not any("Where the model fails" in line for line in lines)


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (10.0, "(another unit?)"),
        (57.3, "(degrees for radians?)"),
        (100.0, "(percent for a share?)"),
        (1e-3, "(another unit?)"),
        (3.0, "at all conditions."),
    ],
)
def test_a_column_in_a_wrong_unit_is_told_as_a_factor_and_no_effect(factor: float, words: str):
    found = answer(heap_problem({}, factor=factor))
    assert found.decided.verdict == "none_detected"
    (shift,) = found.levels
    assert (shift.observable, shift.kind) == ("height", "factor")
    assert shift.size.value == pytest.approx(factor, rel=0.03)
    assert any(words in line for line in discover_answer(found, VOC).lines)


@pytest.mark.parametrize("factor", [10.0, 57.3, 0.01])
def test_a_column_in_a_wrong_unit_hides_no_effect(factor: float):
    found = answer(heap_problem({"bridge": 0.5}, factor=factor))
    assert found.decided.named == ("bridge",)
    assert found.fit.p_after > 0.01


def test_a_number_beyond_its_range_is_told_and_no_effect_is_named_in_its_place():
    found = answer(narrowed(heap_problem({}, friction=0.6), 0.48, 0.53))
    assert found.decided.named == found.decided.group == ()
    assert found.numbers["friction"].at_end
    assert found.fit.p_before < 0.01


def test_an_adopted_effect_is_judged_after_the_offset_of_the_laboratory():
    posterior = raced(heap_problem({"bridge": 0.5}, offset=OFFSET, hidden=HIDDEN), 1)
    found = adopt_record(posterior, ("bridge",), 1)
    assert found.held_out is not None
    assert found.held_out.after < 3.0 < found.held_out.before
    assert found.fit.p_after > 0.01
    assert found.effects["bridge"].strength.low < 0.5 < found.effects["bridge"].strength.high


def test_numbers_are_not_moved_by_a_level():
    found = answer(heap_problem({}, offset=OFFSET, factor=10.0))
    friction = found.numbers["friction"].now
    assert friction.low < TRUE_FRICTION < friction.high
    assert np.isfinite(friction.value)
