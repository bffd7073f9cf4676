"""Rounds of a race on scenes: about what is undecided, never made twice, and tested by fresh runs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import pytest

from doe.trials.reduced.families import FAMILIES
from taichi_erosion.evidence.answers import rounds
from taichi_erosion.evidence.answers.commands import discover_record, open_study, whole
from taichi_erosion.evidence.answers.rounds import RacedStudy, answered, discovery_question
from taichi_erosion.evidence.emulator import gaussian_process, training_runs
from taichi_erosion.evidence.models.load_study import PLANS, BudgetName
from taichi_erosion.evidence.race.decision import decide
from taichi_erosion.evidence.race.posterior import raced, strained
from taichi_erosion.evidence.race.record import Decided
from tests.evidence.emulator.test_training_runs import executing, keys, write

NAME = "rolling_resistance"
STRONG, WEAK, OPEN = 1.5, 0.1, 0.06  # strengths of a name that is sure at once, and of two that are not
NULL, SINGLE, UNLISTED = 1, 33, 113  # cases of one seed of clean ones
OFF = 0.2  # sd of the training values, by which a wrong emulator overstates the effect at strength 1


@dataclass(frozen=True)
class Told:
    """An answer and the runs that it asked for, batch by batch."""

    found: RacedStudy
    runs: list[list[str]]
    plan: str | None  # that decided
    decided: Decided  # as it is said


def told(path: Path, wrong: bool = False, plans: Sequence[BudgetName] = ("quick",)) -> Told:
    runs: list[list[str]] = []
    process = gaussian_process.GaussianProcess
    with pytest.MonkeyPatch.context() as patch, open_study(path) as study:
        patch.setattr(training_runs, "execute", executing(runs))
        if wrong:
            exact = process.mean  # overstated in what the first effect does, without knowing it
            patch.setattr(process, "mean", lambda self, at: exact(self, at) + OFF * self.width * at.psi[:, 0])
        question = discovery_question(study, whole)
        found, ready = answered(study, plans, question, lambda words, share: None)
        decided = discover_record(found).decided
    return Told(found, runs, ready.options.budget, decided)


@cache
def on_function(number: int) -> RacedStudy:
    posterior = raced(FAMILIES["clean"](4242, number).problem, number)
    return RacedStudy(posterior, decide(posterior))


@pytest.mark.parametrize(("strength", "plan"), [(STRONG, "quick"), (OPEN, "full")])
def test_the_large_plan_is_simulated_where_the_small_one_does_not_decide(tmp_path, strength, plan):
    answer = told(write(tmp_path, strength, seed=5), plans=PLANS)
    assert answer.plan == plan
    assert (len(keys(answer.runs)) > 104) == (plan == "full"), "104 runs are the first of the large plan"


def test_a_round_is_made_once_about_what_is_undecided(tmp_path, monkeypatch):
    monkeypatch.setattr(rounds, "undecided", lambda _: True)
    path = write(tmp_path, WEAK, seed=4)
    first = told(path)
    training, more, *_ = first.runs
    assert set(training) < set(more), "about the bare model, rolling, and perhaps both"
    assert len(set(more) - set(training)) in (16, 24)
    again = told(path)
    assert keys(again.runs) == keys(first.runs)
    assert len(again.runs) < len(first.runs), "the round is known"
    assert again.found.posterior.probability == first.found.posterior.probability
    assert again.found.fresh == first.found.fresh


def test_a_name_by_a_wrong_emulator_is_contradicted_and_more_runs_come_first(tmp_path):
    path = write(tmp_path, STRONG)
    answer = told(path, wrong=True)
    fresh = answer.found.fresh
    assert fresh.outcome == "contradicted"
    assert fresh.gap.p < 0.01
    assert fresh.gap.emulated > fresh.gap.simulated, "the effect was overstated"
    assert fresh.more_runs == 24
    decided = answer.decided
    assert (decided.verdict, decided.named, decided.group) == ("unstable", (), (NAME,))
    before = keys(answer.runs)
    again = told(path, wrong=True)
    training, tests = again.runs
    assert len(set(training) - before) == fresh.more_runs
    assert not set(tests) & before
    assert again.decided.verdict == "unstable", "the emulator is as wrong as before"


def test_points_are_the_settings_of_likely_sets_the_bare_model_first():
    found = on_function(NULL)
    doubtful = replace(found, decision=replace(found.decision, none=0.5))
    shares = rounds.sets(found.posterior)
    assert sum(shares.values()) == pytest.approx(1.0)
    bare, *others = rounds.points(doubtful)
    assert bare.effects == {}
    assert 1 <= len(others) <= 2
    best = max((names for names in shares if names), key=lambda names: shares[names])
    assert tuple(others[0].effects) == best
    assert all(set(point.parameters) == set(bare.parameters) for point in others)
    assert rounds.points(replace(found, decision=replace(found.decision, none=0.95))) == []


def test_mechanisms_are_asked_only_where_no_listed_effect_suffices():
    null, single = on_function(NULL), on_function(SINGLE)
    assert not strained(null.posterior.race)
    assert not strained(single.posterior.race), "P(none) is small, but an effect is named"
    assert rounds.required(single) == []
    outside = replace(single, decision=replace(single.decision, verdict="outside_library", named=()))
    assert strained(on_function(UNLISTED).posterior.race)
    closest, *several = rounds.required(outside)
    assert tuple(closest.effects) == single.decision.named
    assert all(len(point.effects) > 1 for point in several)
