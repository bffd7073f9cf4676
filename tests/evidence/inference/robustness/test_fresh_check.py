"""Decisions of a test by fresh runs, the simulations made up about a known analysis."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.evidence.data.fresh_findings import EmulatorGap
from taichi_erosion.evidence.emulator.fresh_runs import FreshCampaign, FreshRuns, GapTest
from taichi_erosion.evidence.inference.pipeline import Analysis
from taichi_erosion.evidence.inference.robustness.fresh_check import (
    Rival,
    after_check,
    contenders,
    fresh_check,
    outcome_of,
)

KEYS = frozenset(f"run {k}" for k in range(12))
FINE = GapTest(p=0.5, row=0, emulated=1.0, emulated_sd=0.1, simulated=1.1, simulated_sd=0.1)
Means = Callable[[list[np.ndarray]], list[np.ndarray]]


def simulation(wet: Analysis, means: Means, sd: float = 0.1, test: GapTest = FINE, failed: int = 0):
    """Fresh runs whose means are made of the emulated ones; scatter of the mean in sd of a measurement."""
    items = [wet.final, *(item for item, _ in contenders(wet))]
    own = means([item.expansion.mean for item in items])
    columns = sd * np.diag(wet.fitted.prepared.sd)

    def simulate(settings, asked, weight, progress) -> FreshCampaign:
        assert len(settings) == len(own)
        assert weight.shape == own[0].shape
        runs = [FreshRuns(np.array([mean, mean]), columns, {"any": test}) for mean in own]
        return FreshCampaign(tuple(runs), KEYS, 2, failed)

    return simulate


def told(wet: Analysis, *made, **more):
    return fresh_check(wet, simulation(wet, *made, **more), lambda words, share: None)[0]


def same(means):
    return means


def exchanged(means):
    return [means[-1], *means[1:-1], means[0]]


def test_what_contradicts_a_name_lacks_it(wet):
    others = contenders(wet)
    assert [role for _, role in others][-1] == "bare"
    assert all("liquid_bridge" not in item.names for item, _ in others)


def test_simulations_as_emulated_confirm_and_keep_the_odds(wet):
    check = told(wet, same, sd=1e-3)
    assert (check.outcome, check.agreement) == ("confirmed", 1.0)
    for each in check.settings[1:]:
        assert each.log_odds_simulated == pytest.approx(each.log_odds_expected, abs=1e-9)
        # the grid of a strength is laid anew: half a unit of ln evidence on either side
        assert each.log_odds_simulated == pytest.approx(each.log_odds_emulated, abs=1.0)
    assert after_check(wet, check).decision == wet.decision


def test_simulations_that_fit_better_without_the_effect_withdraw_it(wet):
    check = told(wet, exchanged)
    bare = check.settings[-1]
    assert check.outcome == "contradicted"
    assert bare.log_odds_simulated < 0.0 < bare.log_odds_expected
    assert check.agreement == 0.0
    after = after_check(wet, check)
    assert (after.decision.verdict, after.decision.named, after.stability) == ("unstable", (), 0.0)
    assert after.decision.group == ("liquid_bridge",)


@pytest.mark.parametrize(
    ("expected", "simulated", "outcome"),
    [
        (0.5, -1.0, "undecided"),  # a right emulator would not have kept the odds either
        (5.0, -1.0, "contradicted"),
        (5.0, 1.0, "contradicted"),  # still likelier, but below the odds of a name
        (5.0, 2.0, "confirmed"),
    ],
)
def test_odds_that_these_runs_could_not_have_kept_contradict_nothing(wet, expected, simulated, outcome):
    rival = Rival(wet.fitted.base, "bare", np.log(4.0), 6.0, expected, simulated, (simulated,))
    gap = EmulatorGap("any", {}, 1.0, 0.1, 1.0, 0.1, p=0.5)
    assert outcome_of([rival], [gap, gap], FreshCampaign((), KEYS, 2)) == outcome


def test_an_emulator_that_is_off_withdraws_the_name_though_the_odds_stand(wet):
    # three explanations: Holm multiplies the least chance by their number
    count = len(contenders(wet)) + 1
    off = replace(FINE, p=0.009 / count)
    assert told(wet, same, test=off).outcome == "contradicted"
    assert told(wet, same, test=replace(off, p=0.011 / count)).outcome == "confirmed"


def test_runs_most_of_which_fail_decide_nothing(wet):
    assert told(wet, exchanged, failed=7).outcome == "undecided"


def test_a_row_without_a_run_keeps_the_emulated_value(wet):
    def first_lost(means):
        return [np.concatenate([[np.nan], mean[1:]]) for mean in means]

    check = told(wet, first_lost, sd=1e-3)
    assert check.outcome == "confirmed"
    assert np.isnan(check.rows["told"].simulated[0])
    for each in check.settings[1:]:
        assert each.log_odds_simulated == pytest.approx(each.log_odds_expected, abs=1e-9)


def test_no_room_for_runs_is_told_with_their_number(wet):
    check, keys = fresh_check(wet, lambda *asked: FreshCampaign((), KEYS, 0), lambda words, share: None)
    assert (check.outcome, check.needed, keys) == ("not_made", len(KEYS), frozenset())
