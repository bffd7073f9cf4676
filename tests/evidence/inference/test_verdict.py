"""Decision rules: which probabilities make a name, a group, something unlisted, or silence."""

from types import SimpleNamespace

import numpy as np
import pytest

from taichi_erosion.evidence.data.findings import NONE, OUTSIDE
from taichi_erosion.evidence.inference.posterior import Posterior
from taichi_erosion.evidence.inference.verdict import Decision, decide

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


def test_two_halves_of_the_probability_make_a_group():
    found = verdict(posterior(a=0.5, b=0.45), fitted("a", 10.0), fitted("b", 11.0))
    assert (found.verdict, found.group) == ("group", ("a", "b"))
    assert found.named == (), "a tie names nobody"


def test_a_likely_pair_is_named_as_two():
    assert set(verdict(posterior(a_b=0.95)).named) == {"a", "b"}


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
