"""What is said where a laboratory is off at all conditions, or a number lies beyond its range."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.evidence.answers.commands import adopt_record
from taichi_erosion.evidence.data.problem import Observable, Parameter, Problem, Vault
from taichi_erosion.evidence.race.posterior import raced
from taichi_erosion.evidence.race.summary import summary
from taichi_erosion.evidence.words.answer_lines import discover_answer
from tests.evidence.linear_study import linear_problem
from tests.evidence.race.test_errors import heaps
from tests.evidence.ten_records import VOC

OFFSET = 1.5  # fifteen sd of a row
BEND = {"bend": 1.0}


def off(acting: dict[str, float], factor: float = 0.0, **changes) -> Problem:
    """A laboratory that reads more by OFFSET, or on a logarithmic scale by a factor."""
    shapes = {"bend": lambda x: x**2, "wave": lambda x: np.sin(3.0 * x)}
    problem = replace(linear_problem(shapes, acting, calibrated=False), **changes)
    table, linear = problem.measurements, problem.model
    if not factor:
        return replace(problem, measurements=replace(table, value=table.value + OFFSET))
    value = factor * np.exp(table.value)
    return replace(
        problem,
        measurements=replace(table, value=value, sd=value * table.sd),
        observables={"y": Observable("y", "log")},
        model=lambda *asked: np.exp(linear(*asked)),
    )


def test_an_offset_of_the_laboratory_is_told_as_a_level_and_along_no_condition():
    found = summary(raced(off({}), 1))
    assert found.decided.verdict == "none_detected"
    assert found.decided.probabilities["none"] > 0.8
    (shift,) = found.levels
    assert (shift.observable, shift.kind) == ("y", "offset")
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
        (3.0, "at all conditions."),
    ],
)
def test_a_column_in_a_wrong_unit_is_told_as_a_factor_and_hides_no_effect(factor: float, words: str):
    found = summary(raced(off({}, factor), 1))
    assert found.decided.verdict == "none_detected"
    (shift,) = found.levels
    assert (shift.observable, shift.kind) == ("y", "factor")
    assert shift.size.value == pytest.approx(factor, rel=0.06)  # sd of a mean of 24 rows: 0.02
    assert any(words in line for line in discover_answer(found, VOC).lines)
    acting = summary(raced(off(BEND, factor), 1))
    assert acting.decided.named == ("bend",)
    assert acting.fit.p_after > 0.01


def test_an_adopted_effect_is_judged_after_the_offset_of_the_laboratory():
    found = adopt_record(raced(off(BEND, vault=Vault(np.arange(3, 24, 5))), 1), ("bend",), 1)
    assert found.held_out.after < 3.0 < found.held_out.before
    assert found.fit.p_after > 0.01
    assert found.effects["bend"].strength.low < 1.0 < found.effects["bend"].strength.high


def test_an_adoption_that_improves_and_does_not_suffice_is_a_misfit():
    problem = off({"bend": 3.0}, vault=Vault(np.arange(3, 24, 5)))
    table = problem.measurements
    table = replace(table, value=table.value + 1.5 * np.cos(9.0 * table.conditions["x"]))
    found = adopt_record(raced(replace(problem, measurements=table), 1), ("bend",), 1)
    assert found.held_out.after < found.held_out.before
    assert found.fit.p_after < 0.01


def test_numbers_are_not_moved_by_a_level():
    problem = heaps(1)
    table = problem.measurements
    value = table.value + OFFSET * (np.array(table.observable) == "angle")
    found = summary(raced(replace(problem, measurements=replace(table, value=value)), 1))
    slope = found.numbers["slope"].now
    assert slope.low < 0.4 < slope.high < slope.low + 0.3
    assert [level.observable for level in found.levels] == ["angle"]


def test_a_number_beyond_its_range_is_told_and_no_effect_is_named_in_its_place():
    narrow = (Parameter("slope", 0.1, 0.01, 0.15, 1.0),)  # of 0.4
    found = summary(raced(replace(heaps(1), parameters=narrow), 1))
    assert found.decided.named == found.decided.group == ()
    assert found.numbers["slope"].at_end
    assert found.fit.p_before < 0.01
