"""What is said where laboratory, code, range or table are off, in closed form.

Heaps of two observables, two conditions and one friction:

    angle  = 25 + 40 (mu - 0.5) d + 6 s_bridge w + 2 s_size (d - 1.5)                          [deg]
    height = 10 exp(0.4 ln(mu / 0.5) d + 0.3 s_bridge w - 0.2 s_size (d - 1.5))                 [mm]

with friction mu, moisture w at five levels, grain diameter d at two, strengths s. `flat` acts where `cover`
is above 0, which no row has.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from doe.trials.reduced.laboratory import Readings, table_of
from taichi_erosion.evidence.answers.commands import adopt_record
from taichi_erosion.evidence.data.problem import Candidate, Observable, Parameter, Problem, Vault
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.race.posterior import raced
from taichi_erosion.evidence.race.record import Record
from taichi_erosion.evidence.race.summary import summary
from taichi_erosion.evidence.words.answer_lines import discover_answer
from taichi_erosion.scene.schema.units import Scale
from tests.evidence.ten_records import VOC

OFFSET = 1.5  # deg, five sd of a row
HIDDEN = (2, 7, 12, 17)  # rows held out: two sets of conditions
MOISTURE, DIAMETER = np.linspace(0.0, 1.0, 5), np.array([1.0, 2.0])
SD = {"angle": 0.3, "height": 0.1}
FRICTION, TRUE_FRICTION = 0.5, 0.53
EFFECTS = ("bridge", "size", "flat")


def value(
    observable: str, w: np.ndarray, d: np.ndarray, mu: float, acting: Mapping[str, float]
) -> np.ndarray:
    """One observable at some conditions."""
    bridge, size = acting.get("bridge", 0.0) * w, acting.get("size", 0.0) * (d - 1.5)
    if observable == "angle":
        return 25.0 + 40.0 * (mu - FRICTION) * d + 6.0 * bridge + 2.0 * size
    return 10.0 * np.exp(0.4 * np.log(mu / FRICTION) * d + 0.3 * bridge - 0.2 * size)


def model(observable, conditions, parameters, effects, seeds):
    w, d = conditions["moisture"], conditions["diameter"]
    found = value(observable, w, d, parameters["friction"], effects)
    return np.repeat(found[np.newaxis], seeds.size, axis=0)


def heap_problem(
    acting: Mapping[str, float],
    offset: float = 0.0,
    factor: float = 1.0,
    friction: float = TRUE_FRICTION,
    hidden: tuple[int, ...] = (),
) -> Problem:
    """A laboratory off by `offset` in angles and `factor` in heights."""
    random = np.random.default_rng(0)
    w, d = (column.ravel() for column in np.meshgrid(MOISTURE, DIAMETER, indexing="ij"))
    group = tuple(f"w{a:g} d{b:g}" for a, b in zip(w, d, strict=True))
    parts, at = [], {"moisture": w, "diameter": d, "cover": np.zeros(w.size)}
    for name, sd in SD.items():
        exact = value(name, w, d, friction, acting)
        noisy = exact + sd * random.standard_normal(w.size)
        level = factor if name == "height" else 1.0
        read = noisy + offset if name == "angle" else noisy * factor
        parts.append(Readings(name, at, read, np.full(w.size, level * sd), group))
    units = TableUnits({"angle": Scale("deg"), "height": Scale("mm")})
    table = replace(table_of(parts), table_units=units)
    candidates = tuple(
        Candidate(name, mask=(lambda at: at["cover"] > 0.0) if name == "flat" else None) for name in EFFECTS
    )
    return Problem(
        table,
        {"height": Observable("height", "log")},
        (Parameter("friction", FRICTION, 0.3, 0.8, 0.1),),
        candidates,
        model,
        vault=Vault(np.array(hidden, dtype=np.int64)),
    )


def narrowed(problem: Problem, low: float, high: float) -> Problem:
    """The same with another range of friction."""
    (number,) = problem.parameters
    return replace(problem, parameters=(replace(number, low=low, high=high),))


def answer(problem: Problem) -> Record:
    """The record of the race."""
    return summary(raced(problem, 1))


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
    assert found.held_out.after < 3.0 < found.held_out.before
    assert found.fit.p_after > 0.01
    assert found.effects["bridge"].strength.low < 0.5 < found.effects["bridge"].strength.high


def test_numbers_are_not_moved_by_a_level():
    found = answer(heap_problem({}, offset=OFFSET, factor=10.0))
    friction = found.numbers["friction"].now
    assert friction.low < TRUE_FRICTION < friction.high
    assert np.isfinite(friction.value)
