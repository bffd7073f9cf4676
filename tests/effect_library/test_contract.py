"""Every effect and mechanism honours one contract; a new file of either is covered without an edit here."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import make_dataclass, replace
from typing import Any

import pytest
from own_effects import LIBRARY, OWN

from taichi_erosion.core.effect import Check, Effect, Probe, quantity
from taichi_erosion.core.effect_probe import make_probe
from taichi_erosion.core.ti import ti
from taichi_erosion.effect_library import shipped_effects
from taichi_erosion.mechanisms.library import load_mechanisms
from taichi_erosion.verification.effect_contract import CLAUSES, breaches, usable_probe

KEPT = LIBRARY | load_mechanisms()
PROBES: dict[str, Probe] = {}  # of the effects that were met


@pytest.mark.parametrize("clause", CLAUSES.values(), ids=CLAUSES.keys())
@pytest.mark.parametrize("name", KEPT)
def test_every_effect_keeps_the_contract(name, clause, bench):
    if name not in PROBES:
        PROBES[name] = make_probe(KEPT[name], bench)
    assert list(clause(KEPT[name], PROBES[name])) == []


def test_the_library_holds_every_file_of_its_folder_under_the_name_of_the_file():
    assert len(LIBRARY) == len(shipped_effects()) + len(OWN)
    assert set(shipped_effects()) < set(LIBRARY)


GOOD, AGEING = LIBRARY["constant_pull"], LIBRARY["ageing_pull"]


def tableless(probe: Probe) -> Iterator[Check]:
    yield Check("one line only", 1.0, 1.0)


def of_one(number: Any, name: str = "pull_off") -> type:
    return make_dataclass("Numbers", [(name, float, number)], frozen=True)


def in_unit(unit: str) -> Effect:
    """The good effect with its parameter in a unit."""
    return replace(GOOD, params=of_one(quantity(1e-7, unit, "pull-off force", low=0.0, high=1e-3)))


def giving(pull: Callable[[float, Mapping[str, float]], float]) -> Effect:
    """The good effect with another pull for its nominal one, at a strength and under conditions [N]."""

    def constants(params, strength, conditions):
        return {"pull": params.pull_off * pull(strength, conditions)}

    return replace(GOOD, constants=constants)


@ti.func
def forget_the_numbers(constants, grain, state):
    after = state
    after.age = grain.interval / 0.0
    return after


@ti.func
def pull_anyway(constants, pair, state_i, state_j):
    return ti.min(state_i.age, 1e-9)


ROOTED = giving(lambda strength, known: strength * known.get("root_density", 1.0))
BAD: dict[str, Effect] = {
    "pull_off has the unit 'Nn/fur', which is not known": in_unit("Nn/fur"),
    "pull_off is declared in uN; numbers of an effect are in SI units": in_unit("uN"),
    "got 0, want": giving(lambda strength, known: 0.0),
    "got 4e-06, want 2e-06": giving(lambda strength, known: 2.0 * strength),
    "its table has 1 lines": replace(GOOD, checks=tableless),
    "no line of its table notices that pull_off": replace(GOOD, checks=tableless),
    "it acts at strength 0": giving(lambda strength, known: 1.0),
    "pull_off has no range": replace(GOOD, params=of_one(quantity(1e-7, "N", "without a range"))),
    "its docstring lacks 'Reference:'": replace(GOOD, doc="Pulls."),
    "it reads 'mosture', which is not among the conditions of a scene; did you mean 'moisture'?": replace(
        GOOD, reads=("mosture",)
    ),
    "it reads the condition 'root_density', which its entry reads = (...) does not name": ROOTED,
    "it reads the condition 'moisture', which its": replace(
        GOOD, can_act=lambda conditions: conditions["moisture"] > 0.0, reads=("slope",)
    ),
    "cannot be told: ZeroDivisionError": replace(GOOD, checks=lambda probe: [1.0 / 0.0]),
    "its reach is inf": replace(GOOD, reach=lambda constants, radius: float("inf")),
    "uncertain.colour is none of its parameters": replace(GOOD, uncertain={"colour": 0.5}),
    "uncertain.pull_off = 0.0 is no standard": replace(GOOD, uncertain={"pull_off": 0.0}),
    "prior_scale = 0.0 must lie": replace(GOOD, prior_scale=0.0),
    "grain_state.age is declared without unit": replace(AGEING, grain_state=of_one(0.0, "age")),
    "a state variable is not finite": replace(AGEING, update_state=forget_the_numbers),
    "it acts at strength": replace(AGEING, act=pull_anyway),
    "no line of its table notices that still": replace(AGEING, checks=tableless),
}


@pytest.mark.parametrize("sentence", BAD)
def test_a_breach_of_the_contract_is_told(sentence, bench):
    assert any(sentence in breach for breach in breaches(BAD[sentence], usable_probe(BAD[sentence], bench)))


def test_an_effect_may_read_a_condition_that_no_scene_has_by_itself(bench):
    rooted = replace(ROOTED, reads=("root_density",))
    assert breaches(rooted, usable_probe(rooted, bench)) == []


def test_a_memory_that_nothing_keeps_is_refused_at_once():
    with pytest.raises(ValueError, match="grain_state and update_state go together"):
        replace(AGEING, update_state=None)
    with pytest.raises(ValueError, match="place first_contact has no grain_state"):
        replace(LIBRARY["midair_passing"], grain_state=AGEING.grain_state, update_state=AGEING.update_state)
