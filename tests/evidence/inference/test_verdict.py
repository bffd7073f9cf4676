"""Decision rules: which probabilities make a name, a group, something unlisted, or silence."""

from types import SimpleNamespace

import numpy as np
import pytest

from taichi_erosion.evidence.data.findings import NONE, OUTSIDE
from taichi_erosion.evidence.inference.posterior import Posterior
from taichi_erosion.evidence.inference.verdict import (
    Decision,
    acting_decision,
    adequate_decision,
    best_hypothesis,
    credible_group,
    decide,
    equal_rivals,
)

POWERS = [0.9, 0.9, 0.1]


def posterior(**probability: float) -> Posterior:
    """Probabilities given by effect, pairs as a_b; the rest is "none"."""
    table = {key.replace("_", "+"): value for key, value in probability.items() if key != "outside"}
    inclusion = {effect: sum(v for k, v in table.items() if effect in k.split("+")) for effect in "abc"}
    rest = {OUTSIDE: probability.get("outside", 0.0)}
    rest[NONE] = 1.0 - sum(table.values()) - rest[OUTSIDE]
    return Posterior(table | rest, inclusion, {}, np.ones(1))


def fitted(names: str, misfit: float):
    return SimpleNamespace(names=tuple(names), fit=SimpleNamespace(misfit=misfit))


def verdict(believed: Posterior, *refits, p: float = 0.001, p_misfit: float = 0.5) -> Decision:
    return decide(believed, list(refits), p, p_misfit, POWERS)


def test_one_likely_effect_far_before_its_rivals_is_named_alone():
    assert verdict(posterior(a=0.95, b=0.02), fitted("a", 10.0), fitted("b", 20.0)) == Decision(
        "present", ("a",)
    )


def test_an_effect_that_fits_as_well_makes_a_group_however_unlikely_it_was_before():
    found = verdict(posterior(a=0.9, b=0.05), fitted("a", 10.0), fitted("b", 12.9))
    assert (found.verdict, set(found.group)) == ("group", {"a", "b"})


def test_two_halves_of_the_probability_make_a_group():
    found = verdict(posterior(a=0.5, b=0.45), fitted("a", 10.0), fitted("b", 11.0))
    assert (found.verdict, found.group) == ("group", ("a", "b"))
    assert found.named == (), "a tie names nobody"


def test_a_rival_that_nobody_believes_makes_no_group():
    found = verdict(posterior(a=0.995, b=0.001), fitted("a", 10.0), fitted("b", 12.9))
    assert found == Decision("present", ("a",))


def test_a_name_of_strength_zero_is_withdrawn():
    idle = SimpleNamespace(fit=SimpleNamespace(acting=lambda: {"a": 0.0, "b": 1.2}))
    assert acting_decision(Decision("present", ("a", "b")), idle) == Decision("present", ("b",))
    assert acting_decision(Decision("present", ("a",)), idle) == Decision("outside_library")


def test_a_likely_pair_is_named_as_two():
    assert set(verdict(posterior(a_b=0.95)).named) == {"a", "b"}


def test_where_the_second_effect_is_open_the_first_is_not_named_alone():
    found = verdict(posterior(a_b=0.45, a_c=0.45, a=0.05), fitted("a", 10.0))
    assert (found.verdict, found.named) == ("group", ("a",))
    assert set(found.group) == {"a", "b", "c"}


@pytest.mark.parametrize(
    ("p", "p_misfit", "expected"),
    [
        (0.001, 0.5, "present"),
        (0.06, 0.5, "none_detected"),
        (0.06, 0.005, "present"),
        (0.06, np.nan, "none_detected"),
    ],
)
def test_without_a_significant_candidate_or_misfit_nothing_is_named(p, p_misfit, expected):
    assert verdict(posterior(a=0.95), p=p, p_misfit=p_misfit).verdict == expected


def test_nothing_is_said_while_nothing_is_the_likeliest():
    assert verdict(posterior(a=0.55)).verdict == "none_detected", "none at 0.45 is above its limit"
    assert decide(posterior(a=0.3), [], 0.001, 0.5, [0.9, 0.1, 0.1]).verdict == "not_testable"
    assert decide(posterior(), [], 1.0, 0.5, []).verdict == "not_testable"


def test_something_unlisted_must_be_likelier_than_all_names_together():
    assert verdict(posterior(outside=0.5, a=0.45)).verdict == "outside_library"
    assert verdict(posterior(outside=0.45, a=0.5)).verdict != "outside_library"


def test_a_credible_group_is_the_smallest_that_holds_nine_tenths():
    assert credible_group(posterior(a=0.5, b=0.42, c=0.05)) == ["a", "b"]
    assert credible_group(posterior(a=0.91, b=0.05)) == ["a"]


def test_rivals_fit_within_three_of_the_best_and_are_singles():
    refits = [fitted("a", 10.0), fitted("b", 12.9), fitted("c", 13.1), fitted("ab", 9.0)]
    assert equal_rivals(refits, ["a"]) == ["b"]
    assert equal_rivals(refits, ["a", "b"]) == []


@pytest.mark.parametrize(
    ("outside", "left", "expected"),
    [
        (0.38, 1.5e-3, "outside_library"),  # an effect that another one imitates
        (0.38, 0.2, "present"),  # nothing is left that would ask for another
        (0.38, np.nan, "present"),  # what is left is unknown
        (0.05, 1.5e-3, "present"),  # the scatter is understated, or a second effect is small
    ],
)
def test_a_name_that_leaves_a_misfit_must_be_likelier_than_something_unlisted(outside, left, expected):
    named = Decision("present", ("a",))
    kept = adequate_decision(named, posterior(outside=outside, a=1.0 - outside), left)
    assert kept == (named if expected == "present" else Decision("outside_library"))


def test_the_likeliest_refit_is_reported_only_where_something_is_named():
    refits = [fitted("a", 10.0), fitted("ab", 9.0)]
    believed = posterior(a=0.2, a_b=0.7)
    assert best_hypothesis(believed, refits, Decision("present", ("a", "b"))) == ("a", "b")
    assert best_hypothesis(believed, refits, Decision("outside_library")) == ()
