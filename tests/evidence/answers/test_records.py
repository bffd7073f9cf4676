"""Records of the commands on cases with a known truth, and what is said of them."""

from functools import cache

from doe.trials.reduced import beyond
from doe.trials.reduced.families import FAMILIES
from taichi_erosion.evidence.answers.commands import (
    adopt_record,
    bare,
    compare_record,
    discover_record,
    next_record,
)
from taichi_erosion.evidence.answers.scene_rounds import RacedStudy
from taichi_erosion.evidence.data.problem import Laboratory, Problem
from taichi_erosion.evidence.race.decision import decide
from taichi_erosion.evidence.race.posterior import Posterior, raced
from taichi_erosion.evidence.race.record import Record
from taichi_erosion.evidence.words.answer_lines import (
    adopt_answer,
    compare_answer,
    discover_answer,
    next_answer,
)
from taichi_erosion.evidence.words.vocabulary import Vocabulary

VOCABULARY = Vocabulary("lab.toml", lambda *words: f"`./erosion {' '.join(map(str, words))}`")
NUMBER = 33  # a single effect that acts, of clean cases


@cache
def case() -> Problem:
    return FAMILIES["clean"](4242, NUMBER).problem


@cache
def acting() -> str:
    (name,) = FAMILIES["clean"](4242, NUMBER).truth["effects"]
    return name


@cache
def posterior() -> Posterior:
    return raced(case(), NUMBER)


def discovered(found: Posterior) -> Record:
    return discover_record(RacedStudy(found, decide(found)))


def adopted(name: str) -> Record:
    return adopt_record(posterior(), [name], NUMBER)


def test_a_comparison_fails_without_the_effect():
    found = raced(bare(case()), NUMBER)
    record = compare_record(RacedStudy(found, decide(found)))
    assert record.fit.p_before < 0.01
    assert record.effects == {}
    assert "fails" in compare_answer(record, VOCABULARY).lines[0]


def test_an_answer_has_the_effect_in_its_first_line_and_its_table():
    record = discovered(posterior())
    told = discover_answer(record, VOCABULARY)
    assert acting() in told.lines[0]
    assert told.table is not None
    assert [row[0] for row in told.table.rows if row[1] == "present"] == [acting()]
    assert len(told.lines) <= 8


def test_adoption_lowers_the_error_of_rows_that_no_fit_has_seen():
    record = adopted(acting())
    assert record.held_out is not None
    assert record.held_out.after < 0.5 * record.held_out.before
    assert record.fit.p_after > 0.01 > record.fit.p_before
    assert "falls" in adopt_answer(record, VOCABULARY).lines[0]


def test_adoption_of_another_effect_does_not_claim_that_the_error_falls():
    other = next(each.name for each in case().candidates if each.name != acting())
    record = adopted(other)
    assert record.held_out is None or "The error falls" not in adopt_answer(record, VOCABULARY).lines[0]


def test_the_law_of_a_mechanism_comes_first():
    problem, truth = beyond.draw(5058)
    record = discovered(raced(problem, 58))
    assert record.law is not None
    assert (record.law.mechanism, record.law.conditions) == (truth.name, (truth.condition,))
    assert truth.condition in discover_answer(record, VOCABULARY).lines[0]


def test_nothing_is_proposed_where_all_is_decided():
    record = next_record(posterior(), Laboratory())
    assert record.experiments == ()
    assert next_answer(record, VOCABULARY).table is None
