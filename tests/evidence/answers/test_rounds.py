"""Rounds of a race on scenes: about what is undecided, never made twice; tests of answers by fresh runs."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest

from doe.trials.reduced.families import FAMILIES
from taichi_erosion.api.studies import new_study
from taichi_erosion.campaign.study_file import WorkersEntry
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers import fresh_test, rounds
from taichi_erosion.evidence.answers.commands import bare, discover_record, infer_all, open_study
from taichi_erosion.evidence.answers.set_up import small_heap_faults
from taichi_erosion.evidence.data.problem import Mechanism, SetUpFault
from taichi_erosion.evidence.data.transforms import to_scale
from taichi_erosion.evidence.emulator import gaussian_process, training_runs
from taichi_erosion.evidence.emulator.design import Setting
from taichi_erosion.evidence.emulator.fresh_runs import FreshCampaign, FreshRuns, FreshSimulator
from taichi_erosion.evidence.models.load_study import PLANS, BudgetName, StudyOptions
from taichi_erosion.evidence.models.simulator import row_at
from taichi_erosion.evidence.race import posterior
from taichi_erosion.evidence.race.decision import decide_cause
from taichi_erosion.evidence.race.fit import Hypothesis
from taichi_erosion.evidence.race.posterior import has_unexplained_misfit, infer
from taichi_erosion.evidence.race.priors import SURE
from taichi_erosion.evidence.record import FreshPart, GapPart
from taichi_erosion.scene.load import SOURCE, load_scene
from tests.evidence.asking import no_progress
from tests.evidence.emulator.test_training_runs import executing, keys, write

NAME = "rolling_resistance"
STRONG, WEAK, OPEN = 1.5, 0.1, 0.3  # strengths of a name that is sure at once, and of two that are not
NULL, SINGLE, UNLISTED = 1, 33, 113  # cases of one seed of clean ones
MECHANISM = (58, "beyond", 5058)  # restitution that grows with moisture
OFF = 0.2  # sd of the training values, by which a wrong emulator overstates the effect at strength 1


def told(path: Path, wrong: bool = False, plans: Sequence[BudgetName] = ("quick",)) -> SimpleNamespace:
    """An answer, as it is said, the plan that decided, and the runs that it asked for, batch by batch."""
    runs: list[list[str]] = []
    process = gaussian_process.GaussianProcess
    with pytest.MonkeyPatch.context() as patch, open_study(path) as study:
        patch.setattr(training_runs, "run_requests", executing(runs))
        if wrong:
            exact = process.mean  # overstated in what the first effect does, without knowing it
            patch.setattr(process, "mean", lambda self, at: exact(self, at) + OFF * self.width * at.psi[:, 0])
        question = rounds.discovery_question(study, infer_all)
        found, ready = rounds.answer_question(study, plans, question, lambda words, share: None)
        record = discover_record(found)
    return SimpleNamespace(found=found, runs=runs, plan=ready.options.budget, record=record)


@cache
def on_function(number: int, family: str = "clean", seed: int = 4242) -> rounds.StudyInference:
    posterior = infer(FAMILIES[family](seed, number).problem, number)
    return rounds.StudyInference(posterior, decide_cause(posterior))


@pytest.mark.parametrize(("strength", "plan"), [(STRONG, "quick"), (OPEN, "full")])
def test_the_large_plan_is_simulated_where_the_small_one_does_not_decide(tmp_path, strength, plan):
    answer = told(write(tmp_path, strength, seed=5), plans=PLANS)
    assert answer.plan == plan
    assert (len(keys(answer.runs)) > 104) == (plan == "full"), "104 runs are the first of the large plan"


def test_what_keeps_an_answer_waiting_is_refused_before_its_runs_unless_forced(tmp_path, monkeypatch):
    runs: list[list[str]] = []
    monkeypatch.setattr(training_runs, "run_requests", executing(runs))
    with open_study(write(tmp_path, STRONG, seed=5)) as study:
        wait = replace(study, faults=(SetUpFault("too_few_rows", "table", "too few rows", True),))
        question = rounds.discovery_question(wait, bare)
        with pytest.raises(BadInput, match="too few rows; --force goes on"):
            rounds.answer_question(wait, ("quick",), question, no_progress)
        assert not runs
        untested = rounds.discovery_question(wait, bare, tested=False)
        rounds.answer_question(wait, ("quick",), untested, no_progress)
        made = len(runs)
        assert made, "the next rows are asked for where there are too few"
        forced = replace(wait, options=StudyOptions(force=True))
        rounds.answer_question(forced, ("quick",), question, no_progress)
        assert len(runs) > made


@pytest.mark.parametrize(("grains", "kinds"), [(300, ["too_small"]), (400, [])])
def test_a_heap_of_too_few_grains_for_any_angle_of_the_table_is_known_before_runs(tmp_path, grains, kinds):
    # a cone of 310 grains at the steepest angle, 40.2 deg, has three rows on its flank
    columns = {"angle of repose [deg]": [31.2, 33.0, 40.2, 36.0], "sd [deg]": 0.8, "moisture [%]": range(4)}
    made = new_study(pd.DataFrame(columns), tmp_path / "heap", apparatus="funnel", grains=grains)
    with open_study(made.path) as study:
        assert [fault.kind for fault in small_heap_faults(study)] == kinds


def test_a_round_is_made_once_about_what_is_undecided(tmp_path, monkeypatch):
    monkeypatch.setattr(rounds, "has_open_question", lambda _: True)
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
    assert (answer.record.verdict, answer.record.named, answer.record.group) == ("unstable", (), (NAME,))
    before = keys(answer.runs)
    again = told(path, wrong=True)
    training, *tests = again.runs
    assert len(set(training) - before) == fresh.more_runs
    assert not {run for batch in tests for run in batch} & before
    assert not again.record.named, "the emulator is as wrong as before"


def test_points_are_the_settings_of_likely_sets_the_bare_model_first():
    found = on_function(NULL)
    decisions = [replace(found.decision, probabilities={"none": p}) for p in (0.5, 0.95)]
    doubtful, sure = (replace(found, decision=decision) for decision in decisions)
    shares = rounds.probability_of_sets(found.posterior)
    assert sum(shares.values()) == pytest.approx(1.0)
    bare, *others = rounds.likeliest_explanation_points(doubtful)
    assert bare.effects == {}
    assert 1 <= len(others) <= 2
    best = max((names for names in shares if names), key=lambda names: shares[names])
    assert tuple(others[0].effects) == best
    assert all(set(point.parameters) == set(bare.parameters) for point in others)
    assert rounds.likeliest_explanation_points(sure) == []


def test_mechanisms_are_asked_only_where_no_listed_effect_suffices():
    null, single = on_function(NULL), on_function(SINGLE)
    assert not has_unexplained_misfit(null.posterior.race)
    assert not has_unexplained_misfit(single.posterior.race), "P(none) is small, but an effect is named"
    assert rounds.points_before_unlisted_verdict(single) == []
    outside = replace(single, decision=replace(single.decision, verdict="outside_library", named=()))
    assert has_unexplained_misfit(on_function(UNLISTED).posterior.race)
    closest, *several = rounds.points_before_unlisted_verdict(outside)
    assert tuple(closest.effects) == single.decision.named
    assert all(len(point.effects) > 1 for point in several)


def test_mechanisms_of_which_runs_are_there_enter_the_race_though_the_misfit_may_be_chance(monkeypatch):
    race = Mock()
    monkeypatch.setattr(posterior, "fit_all_mechanisms", race)
    problem = replace(FAMILIES["clean"](4242, NULL).problem, mechanisms=(Mechanism("stiffness", 0.0, 1.0),))
    for by_row in (False, True):  # a function, that is run for them, and an emulator
        infer(replace(problem, dosed_by_row=by_row), NULL)
        assert race.call_count == by_row


SEEDS, calls = 2, list[tuple[int, int, int]]()  # times the seeds, rows and settings of every call
SIMILAR = {"o": GapPart((), "o", {}, 1.0, 0.1, 1.0, 0.1, p=0.5)}


def asked(
    share: float = 1.0, noise: float = 0.1, fails: float = 0.0, tests=SIMILAR, seed: int = 1, case=(SINGLE,)
) -> FreshPart:
    """The test by a simulator in which effects have a share of their strength and runs scatter by noise."""
    posterior, decision = (found := on_function(*case)).posterior, found.decision
    prepared, model = posterior.race.prepared, posterior.race.prepared.problem.model
    sd, random = prepared.row_sd * noise, np.random.default_rng(seed)

    def value(setting: Setting, observable, at) -> float:
        weaker = {name: share * strength for name, strength in setting.at(row_at(at, 0))[0].items()}
        exact = model(observable.name, at, setting.parameters, weaker, np.arange(1, 200))
        return np.mean(to_scale(observable, exact))

    def simulate(settings, requests, weight, progress, times=1):
        assert weight.max() > 1.0 or times > 1
        made, size = [], sd if times == 1 else np.full(weight.size, sd.mean())
        for setting in settings:
            values = np.full((times * SEEDS, size.size), np.nan)
            for observable, rows, at in requests:
                for k, row in enumerate(rows):
                    values[:, row] = value(setting, observable, {name: x[[k]] for name, x in at.items()})
            values += size * random.standard_normal(values.shape)
            made.append(FreshRuns(values, np.diag(size / np.sqrt(times * SEEDS)), tests))
        keys = frozenset(f"{times} {len(weight)} {k}" for k in range(times * SEEDS * len(settings)))
        calls.append((times, weight.size, len(settings)))
        return FreshCampaign(tuple(made), keys, times * SEEDS, round(fails * len(keys)))

    part, keys = fresh_test.run_fresh_test(posterior, decision, simulate, lambda words, share: None)
    assert len(keys) == part.runs
    return part


@pytest.mark.parametrize("case", [(SINGLE,), MECHANISM])
@pytest.mark.parametrize(("share", "outcome"), [(1.0, "confirmed"), (0.0, "contradicted")])
def test_runs_confirm_what_they_show_and_contradict_what_they_do_not(share, outcome, case):
    part, decision = asked(share, case=case), on_function(*case).decision
    assert (part.outcome, part.effects) == (outcome, decision.named or decision.acting_mechanisms)
    assert part.emulated > SURE
    assert (part.simulated > SURE, part.p > 0.05) == (share == 1.0,) * 2
    assert fresh_test.after_runs(decision, part).acting_mechanisms == decision.acting_mechanisms * int(share)


def test_a_mechanism_is_simulated_at_its_own_doses_and_told_beside_what_takes_its_place():
    found = on_function(*MECHANISM)
    (name,), p = found.decision.acting_mechanisms, found.posterior
    told = fresh_test.run_setting(p.race, p.best_fit)
    assert {own[name] for at, own in told.doses if at["moisture"] == 0.0} == {0.0}
    assert len({own[name] for _, own in told.doses}) > 3
    for shares in ((0.3, 0.65), (0.03, 0.97)):  # a table and a few runs that differ leave both
        rival = FreshPart("contradicted", (name,), simulated=shares[0], rival=("lift",), rivals=shares[1])
        assert fresh_test.after_runs(found.decision, rival).acting_mechanisms == ("lift", name)


def test_runs_that_leave_two_mechanisms_open_get_further_seeds_where_they_tell_most():
    calls.clear()
    parts = [asked(0.5, noise=3.0, seed=seed, case=MECHANISM) for seed in range(4)]
    more = [each for each in calls if each[0] > 1]
    rows = on_function(*MECHANISM).posterior.race.prepared.rows.size
    assert more, "at least one of four was open"
    assert all(times in (2, 4, 8) and size < rows and settings == 2 for times, size, settings in more)
    spent = (fresh_test.CLOSER - 1) * 3 * SEEDS
    assert all(not fresh_test.leaves_mechanisms_open(part) or part.runs > spent for part in parts)
    calls.clear()
    asked(1.0, case=MECHANISM)
    assert [times for times, *_ in calls] == [1], "confirmed at once"


def test_further_seeds_take_the_place_of_the_rows_of_their_set():
    one = FreshRuns(np.array([[1.0, 2.0, 3.0]]), np.eye(3), SIMILAR)
    both = one.merge_fresh_runs(FreshRuns(np.array([[5.0], [7.0]]), np.array([[0.5]]), {}), np.array([1]))
    np.testing.assert_array_equal(both.row_means, [1.0, 6.0, 3.0])
    np.testing.assert_array_equal(np.linalg.norm(both.columns, axis=1), [1.0, 0.5, 1.0])
    assert both.tests is SIMILAR


@pytest.mark.parametrize(("share", "never"), [(1.0, "contradicted"), (0.0, "confirmed")])
def test_runs_that_scatter_say_less_but_nothing_wrong(share, never):
    assert never not in [asked(share, noise=6.0, seed=seed).outcome for seed in range(3)]


@pytest.mark.parametrize(
    ("world", "outcome"),
    [
        ({"share": 0.5}, "confirmed"),  # it is still the right name
        ({"fails": 0.6}, "undecided"),
        ({"tests": {"o": replace(SIMILAR["o"], p=0.004)}}, "confirmed"),
    ],
)
def test_an_effect_half_as_strong_runs_that_fail_and_a_gap_by_chance(world, outcome):
    assert asked(**world).outcome == outcome


def test_only_a_confirmed_name_of_the_small_plan_is_settled():
    found = [replace(on_function(SINGLE), fresh=asked(fails=share)) for share in (0.0, 0.6)]
    assert [rounds.is_final(each) for each in found] == [True, False]


@pytest.mark.parametrize(("left", "verdict"), [(0.6, "unstable"), (0.95, "present"), (np.nan, "present")])
def test_a_name_to_which_fresh_runs_leave_less_than_sure_is_not_given(left, verdict):
    found = on_function(SINGLE)
    part = FreshPart("undecided", found.decision.named, simulated=left)
    assert discover_record(replace(found, fresh=part)).verdict == verdict


def test_an_emulator_that_is_off_by_more_than_its_errors_is_believed_nowhere():
    part = asked(tests={"o": replace(SIMILAR["o"], p=1e-4, simulated=2.0)})
    assert part.outcome == "contradicted"
    assert part.gap.p == pytest.approx(3 * 1e-4), "one test in each of three explanations"


def test_without_room_for_runs_nothing_is_said():
    found, spent = on_function(SINGLE), FreshCampaign((), frozenset("abc"), 0)
    part, keys = fresh_test.run_fresh_test(found.posterior, found.decision, lambda *_: spent, no_progress)
    assert (part.outcome, part.needed, keys) == ("not_made", 3, frozenset())


def test_the_rival_contradicts_the_answer_and_the_bare_model_has_no_effect():
    found = on_function(SINGLE)
    told, rival, bare = fresh_test.answer_and_rivals(found.posterior.race, found.decision)
    assert (told.acting, bare.acting, bool(rival.acting)) == (found.decision.named, (), True)
    assert not fresh_test.confirms(found.decision, Hypothesis(rival.acting))
    assert {fit.hypothesis.names for fit in bare.fits} == {()}


def test_fresh_runs_are_made_by_the_device_of_the_study():
    scene, device = load_scene(SOURCE / "column_collapse.toml"), WorkersEntry(decomposition="grains")
    simulator = SimpleNamespace(device=device, load_scene_at=lambda *_: scene)
    training = SimpleNamespace(study=SimpleNamespace(fresh=""), simulator=simulator)
    fresh = FreshSimulator(cast("Any", training), cast("Any", None), frozenset(), SEEDS)
    made = fresh.point_runs((Path("heap.toml"), ()), SEEDS)
    assert [request.payload["decomposition"] for request in made] == ["grains"] * SEEDS
