"""An answer tested by runs of a stand-in that agrees with the emulator, contradicts it, or scatters."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from doe.trials.reduced.families import FAMILIES
from taichi_erosion.campaign.study_file import WorkersEntry
from taichi_erosion.evidence.answers.fresh_test import fresh_test, is_true, kinds_of
from taichi_erosion.evidence.answers.rounds import RacedStudy, settled
from taichi_erosion.evidence.data.transforms import to_scale
from taichi_erosion.evidence.emulator.fresh_runs import FreshCampaign, FreshRuns, FreshSimulator, GapTest
from taichi_erosion.evidence.race.decision import Decision, decide
from taichi_erosion.evidence.race.fit import Hypothesis
from taichi_erosion.evidence.race.posterior import Posterior, raced
from taichi_erosion.evidence.race.priors import SURE
from taichi_erosion.evidence.race.record import FreshPart
from taichi_erosion.scene.load import SOURCE, load_scene

SINGLE = 33  # case of one strong effect
SEEDS = 2
SIMILAR = {"o": GapTest(0.5, 0, 1.0, 0.1, 1.0, 0.1)}


@cache
def answered() -> tuple[Posterior, Decision]:
    posterior = raced(FAMILIES["clean"](4242, SINGLE).problem, SINGLE)
    return posterior, decide(posterior)


def asked(
    share: float = 1.0, noise: float = 0.1, fails: float = 0.0, tests=SIMILAR, seed: int = 1
) -> FreshPart:
    """The test by a simulator in which every effect has a share of its strength and a run scatters by so many
    sd of a row."""
    posterior, decision = answered()
    prepared, model = posterior.race.prepared, posterior.race.prepared.problem.model
    sd, random = prepared.sd * noise, np.random.default_rng(seed)

    def simulate(settings, requests, weight, progress):
        assert weight.max() > 1.0
        made = []
        for setting in settings:
            weaker = {name: share * strength for name, strength in setting.effects.items()}
            values = np.full((SEEDS, sd.size), np.nan)
            for observable, rows, at in requests:
                exact = model(observable.name, dict(at), dict(setting.parameters), weaker, np.arange(1, 200))
                values[:, rows] = np.mean(to_scale(observable, np.asarray(exact)), axis=0)
            values += sd * random.standard_normal(values.shape)
            made.append(FreshRuns(values, np.diag(sd / np.sqrt(SEEDS)), tests))
        keys = frozenset(map(str, range(SEEDS * len(settings))))
        return FreshCampaign(tuple(made), keys, SEEDS, round(fails * len(keys)))

    part, keys = fresh_test(posterior, decision, simulate, lambda words, share: None)
    assert len(keys) == part.runs
    return part


def test_runs_that_agree_confirm_the_name():
    part = asked()
    assert (part.outcome, part.effects) == ("confirmed", answered()[1].named)
    assert part.emulated == pytest.approx(answered()[1].inclusion[part.effects[0]], abs=0.02)
    assert part.simulated > SURE
    assert part.agreement == 1.0
    assert part.p > 0.05


def test_runs_in_which_the_effect_does_nothing_contradict_it():
    part = asked(share=0.0)
    assert part.outcome == "contradicted"
    assert part.simulated < 0.1 < SURE < part.emulated
    assert part.agreement == 0.0
    assert part.p < 0.01


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
    found = [RacedStudy(*answered(), asked(fails=share)) for share in (0.0, 0.6)]
    assert [settled(each) for each in found] == [True, False]


def test_an_emulator_that_is_off_by_more_than_its_errors_is_believed_nowhere():
    off = {"o": replace(SIMILAR["o"], p=1e-4, simulated=2.0)}
    part = asked(tests=off)
    assert part.outcome == "contradicted"
    assert part.gap.p == pytest.approx(3 * 1e-4), "one test in each of three explanations"


def test_without_room_for_runs_nothing_is_said():
    part, keys = fresh_test(
        *answered(), lambda *_: FreshCampaign((), frozenset("abc"), 0), lambda words, share: None
    )
    assert (part.outcome, part.needed, keys) == ("not_made", 3, frozenset())


def test_the_rival_contradicts_the_answer_and_the_bare_model_has_no_effect():
    posterior, decision = answered()
    told, rival, bare = kinds_of(posterior.race, decision)
    assert told.names == decision.named
    assert rival.names
    assert not is_true(decision, Hypothesis(rival.names))
    assert bare.names == ()
    assert {fit.hypothesis.names for fit in bare.fits} == {()}


def test_fresh_runs_are_made_by_the_device_of_the_study():
    scene, device = load_scene(SOURCE / "column_collapse.toml"), WorkersEntry(decomposition="grains")
    simulator = SimpleNamespace(device=device, scene=lambda *_: scene)
    training = SimpleNamespace(study=SimpleNamespace(fresh=""), simulator=simulator)
    fresh = FreshSimulator(cast("Any", training), cast("Any", None), frozenset(), SEEDS)
    made = fresh.requests((Path("heap.toml"), ()), SEEDS)
    assert [request.payload["decomposition"] for request in made] == ["grains"] * SEEDS
