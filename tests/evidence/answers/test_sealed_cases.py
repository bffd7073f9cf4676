"""Statistics of the discovery on sealed cases of the closed-form model, and changes that must not change it.

The 3000 cases behind the published table are solved by doe/t0/run.py; here 50 others keep watch. Their
bounds lie three binomial sd beyond the targets, so that chance alone seldom breaks them.
"""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from hashlib import sha256
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

from doe.sealed.cases import draw_case
from doe.sealed.laboratory import CaseModel
from doe.sealed.score import STRONG, Marked, is_top, scores
from doe.sealed.solve import Outcome, solve, solve_file
from doe.sealed.trial import Trial, marked, opened, seal, sealed
from taichi_erosion.evidence.data.problem import Candidate, Problem

FAMILY = 5000  # of the cases watched here
COUNT = 50
MOST_FALSE = 0.04  # of cases, named for what does not act; t0: 7 of 1393 nulls, 13 of 3000 cases
SINGLE, NULL = (7, 15), (7, 4)  # family and number of a case with one strong effect, and of one without


@pytest.fixture(scope="module")
def cases(tmp_path_factory) -> list[Marked]:
    trial = Trial(FAMILY, COUNT, tmp_path_factory.mktemp("trial"))
    seal(trial)
    numbers = range(COUNT)
    problems, answers = [trial.problem(k) for k in numbers], [trial.answer(k) for k in numbers]
    with (
        pytest.MonkeyPatch.context() as around,
        ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool,
    ):
        around.setenv("OPENBLAS_NUM_THREADS", "1")  # read by the processes when they start
        list(pool.map(solve_file, problems, answers, repeat(False), chunksize=5))
        return marked(list(pool.map(opened, repeat(trial), numbers, sealed(trial).values(), chunksize=5)))


def test_beyond_the_drawn_cases_only_pairs_are_asked(tmp_path):
    trial = Trial(FAMILY, 3, tmp_path, further=60)
    assert trial.numbers[:3] == [0, 1, 2]
    assert {draw_case(FAMILY, k).truth.kind for k in trial.numbers[3:]} == {"pair"}
    assert 1 <= len(trial.numbers) - 3 <= 15, "a tenth of the cases are pairs"


def test_further_pairs_count_with_pairs_only(cases):
    again = [replace(case, further=True) for case in of_kind(cases, "pair")]
    alone, both = ({m.name: m.count for m in scores(c)} for c in (cases, [*cases, *again]))
    moved = {name for name in alone if both[name] != alone[name]}
    assert moved
    assert all(name.startswith("pair") for name in moved)
    assert all(both[name] == 2 * alone[name] for name in moved)


def below(share: float, count: int) -> float:
    """Least number of hits out of `count` that a method with this share is allowed: three binomial sd."""
    return count * share - 3.0 * np.sqrt(count * share * (1.0 - share))


def of_kind(cases: list[Marked], kind: str) -> list[Marked]:
    return [case for case in cases if case.truth.kind == kind]


def test_nothing_is_named_where_nothing_is_missing(cases):
    nulls = of_kind(cases, "null")
    assert len(nulls) > 15
    assert sum(bool(case.told) for case in nulls) <= MOST_FALSE * len(nulls)


def test_hardly_any_name_is_false(cases):
    named = [case for case in cases if case.told]
    false = [case for case in named if not case.told & set(case.truth.effects)]
    assert len(named) > 10
    assert len(false) <= MOST_FALSE * len(cases)


def test_a_strong_distinct_effect_ranks_first(cases):
    strong = [c for c in of_kind(cases, "single") if c.hard.ratio >= STRONG and c.hard.separation >= 3.0]
    assert len(strong) > 2
    assert sum(is_top(case) for case in strong) >= below(0.97, len(strong))


def test_an_effect_outside_the_library_is_not_named_with_confidence(cases):
    apart = [c for c in of_kind(cases, "outside") if c.hard.separation >= 3.0]
    assert apart
    assert all(c.answer.verdict != "present" or c.answer.probabilities[c.top] <= 0.9 for c in apart)


def test_intervals_of_calibrated_numbers_hold_the_truth(cases):
    nulls = [c for c in of_kind(cases, "null") if c.truth.understated == 1.0 and not c.told]
    hits = [
        low <= case.truth.parameters[path] <= high
        for case in nulls
        for path, (_, low, high) in case.answer.parameters.items()
    ]
    # numbers of one case are fitted to the same rows: counted as if a third of them were independent
    assert sum(hits) >= 0.9 * len(hits) - 3.0 * np.sqrt(3.0 * len(hits) * 0.09)


def test_a_seal_does_not_fit_another_truth(tmp_path):
    trial = Trial(FAMILY, 1, tmp_path)
    seal(trial)
    with pytest.raises(ValueError, match="not the one that was sealed"):
        opened(trial, 0, sha256(b"another truth").hexdigest())


def test_a_problem_file_holds_no_truth(tmp_path):
    trial = Trial(FAMILY, 4, tmp_path)
    seal(trial)
    written = b"".join(path.read_bytes() for path in Path(tmp_path).rglob("*") if path.is_file())
    assert b"laboratory" in written  # the model is there
    assert b"Truth" not in written
    assert b"understated" not in written


def answer(problem: Problem) -> Outcome:
    return solve(1, problem, with_vault=False)


def problem_of(case: tuple[int, int]) -> Problem:
    return draw_case(*case).problem


def exact(problem: Problem) -> Problem:
    """The same problem with a model without scatter, so that answers may not differ by a seed."""
    model = problem.model
    assert isinstance(model, CaseModel)
    return replace(
        problem, model=CaseModel(0.0, 0.0, model.aliases), vault=replace(problem.vault, rows=no_rows())
    )


def no_rows() -> np.ndarray:
    return np.zeros(0, dtype=np.int64)


def test_the_order_of_rows_and_candidates_does_not_matter():
    problem = exact(problem_of(SINGLE))
    order = np.random.default_rng(3).permutation(problem.measurements.size)
    turned = replace(
        problem, measurements=problem.measurements.rows(order), candidates=problem.candidates[::-1]
    )
    one, other = answer(problem), answer(turned)
    assert one.verdict == other.verdict == "present"
    assert one.named == other.named
    assert one.strengths[one.named[0]] == pytest.approx(other.strengths[one.named[0]], rel=1e-3)


def test_the_names_of_candidates_do_not_matter():
    problem = exact(problem_of(SINGLE))
    names = {candidate.name: f"effect {10 + k}" for k, candidate in enumerate(problem.candidates)}
    model = CaseModel(0.0, 0.0, {new: old for old, new in names.items()})
    renamed = replace(
        problem, candidates=tuple(Candidate(names[c.name]) for c in problem.candidates), model=model
    )
    one, other = answer(problem), answer(renamed)
    assert tuple(names[name] for name in one.named) == other.named


class InKilometres:
    """A model whose conditions come in thousandths of their unit."""

    def __init__(self, model):
        self.model = model

    def __call__(self, observable, conditions, parameters, effects, seeds):
        there = {name: 1e3 * column for name, column in conditions.items()}
        return self.model(observable, there, parameters, effects, seeds)


def test_the_units_of_conditions_do_not_matter():
    problem = exact(problem_of(SINGLE))
    table = problem.measurements
    scaled = replace(table, conditions={name: 1e-3 * column for name, column in table.conditions.items()})
    other = answer(replace(problem, measurements=scaled, model=InKilometres(problem.model)))
    one = answer(problem)
    assert one.named == other.named
    for name, share in one.probabilities.items():
        assert other.probabilities[name] == pytest.approx(share, abs=1e-3)


def test_shuffled_values_name_nothing():
    problem = problem_of(SINGLE)
    table, random = problem.measurements, np.random.default_rng(5)
    order = np.arange(table.size)
    for name in set(table.observable):
        rows = np.flatnonzero([entry == name for entry in table.observable])
        order[rows] = random.permutation(rows)
    shuffled = replace(table, value=table.value[order], sd=table.sd[order])
    found = answer(replace(problem, measurements=shuffled))
    assert found.verdict in ("outside_library", "none_detected", "not_testable")


def test_a_candidate_listed_twice_makes_a_group():
    problem = exact(problem_of(SINGLE))
    (named,) = answer(problem).named
    model = CaseModel(0.0, 0.0, {**{c.name: c.name for c in problem.candidates}, "twin": named})
    twice = replace(problem, candidates=(*problem.candidates, Candidate("twin")), model=model)
    found = answer(twice)
    assert found.verdict == "group"
    assert {named, "twin"} <= set(found.group)


def test_doubled_sd_does_not_raise_confidence():
    problem = exact(problem_of(SINGLE))
    doubled = replace(problem.measurements, sd=2.0 * problem.measurements.sd)
    one, other = answer(problem), answer(replace(problem, measurements=doubled))
    (named,) = one.named
    assert other.probabilities["none"] >= one.probabilities["none"]
    assert other.p >= one.p
    width = [
        low_high[2] - low_high[1]
        for low_high in (one.strengths[named], other.strengths.get(named, (0, 0, 9)))
    ]
    assert width[1] > width[0]


def test_a_null_stays_a_null_whatever_the_seed():
    problem = problem_of(NULL)
    assert {solve(seed, problem, False).verdict for seed in range(3)} <= {"none_detected", "not_testable"}
