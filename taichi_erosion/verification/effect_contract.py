"""The contract that every effect keeps, checked on one effect at a time.

Each clause gives one sentence for every breach of it, and nothing for an effect that keeps it. The device
must have been started.
"""

from collections.abc import Callable, Iterator
from dataclasses import asdict, fields, is_dataclass, replace
from math import isclose, isfinite
from typing import Any

import numpy as np

from taichi_erosion.core.effect import Check, Effect, Probe, check_range, documented
from taichi_erosion.core.effect_probe import TYPICAL, Bench, falsified, probe_of
from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import Scene, resolved
from taichi_erosion.scene.change import sample_scene
from taichi_erosion.scene.schema.conditions import Conditions

LEAST_CHECKS = 3
WRONG = 1.1  # factor by which a parameter is falsified
CONDITIONS = {  # a laboratory that states every condition
    "moisture": 0.02,
    "temperature": 300.0,
    "relative_humidity": 0.3,
    "pressure": 9e4,
    "altitude": 1000.0,
    "slope": 5.0,
    "diameter": 2e-4,
    "angularity": 0.5,
    "friction_velocity": 0.35,
}
SCENES: tuple[dict[str, Any], ...] = (  # with and without wind
    {"conditions": CONDITIONS},
    {"conditions": CONDITIONS, "wind": {"length": 0.02, "width": 0.01, "height": 0.05}},
)
ENDS = ("low", "high")  # of the range of a parameter
RESTING = TYPICAL["grain"] | {"velocity": (0.0, 0.0, 0.0), "spin": (0.0, 0.0, 0.0), "interval": 1.0}
READINGS = ("repose_angle", "threshold_u_star", "fluid_threshold_stress", "flux", "pile_height")


def holds(check: Check) -> bool:
    """Whether a line of a table is right."""
    return isclose(check.got, check.want, rel_tol=check.rtol, abs_tol=check.atol)


def table_is_right(effect: Effect, probe: Probe) -> Iterator[str]:
    """The verification table has at least three lines, and all are right."""
    table = list(effect.checks(probe))
    if len(table) < LEAST_CHECKS:
        yield f"its table has {len(table)} lines; at least {LEAST_CHECKS} are needed"
    for check in table:
        if not holds(check):
            yield f"{check.claim}: got {check.got:.6g}, want {check.want:.6g}"


def parameters_are_pinned(effect: Effect, probe: Probe) -> Iterator[str]:
    """Making any one parameter wrong by 10 % breaks some line of the table."""
    for name in (f.name for f in fields(effect.params)):
        if all(holds(check) for check in effect.checks(falsified(probe, name, WRONG))):
            yield f"no line of its table notices that {name} is wrong by 10 %"


def parameters_are_documented(effect: Effect, probe: Probe) -> Iterator[str]:
    """Parameters carry unit, meaning and a finite range that holds their default."""
    if not is_dataclass(effect.params):
        yield "params is not a dataclass"
        return
    for f in fields(effect.params):
        if not is_declared(f):
            yield f"{f.name} is declared without unit or meaning; use quantity"
        elif not isfinite(f.metadata["low"]) or not isfinite(f.metadata["high"]):
            yield f"{f.name} has no range"
    try:
        check_range(effect.params())
    except ValueError as error:
        yield str(error)


def is_declared(f: Any) -> bool:
    """Whether a number is declared with unit and meaning."""
    return documented(f) and bool(f.metadata["meaning"]) and bool(f.metadata["unit"])


def grain_state_is_sound(effect: Effect, probe: Probe) -> Iterator[str]:
    """State variables of grains carry unit and meaning, begin as declared, and stay finite."""
    if effect.grain_state is None:
        return
    for f in fields(effect.grain_state):
        if not is_declared(f):
            yield f"grain_state.{f.name} is declared without unit or meaning; use quantity"
    for params in (effect.params(), *extreme_params(effect)):
        for state in reached_states(effect, probe, params, 1.0):
            if not np.all(np.isfinite(list(asdict(state).values()))):
                yield f"with {params} a state variable is not finite"


def is_described(effect: Effect, probe: Probe) -> Iterator[str]:
    """Docstring with a reference and what strength does; title, prior, conditions that exist."""
    doc = effect.doc or ""
    for word in ("Reference:", "trength", "Holds"):
        if word not in doc:
            yield f"its docstring lacks '{word}'"
    if not effect.title:
        yield "it has no title"
    if not 0.0 < effect.prior_scale <= effect.most:
        yield f"prior_scale = {effect.prior_scale} must lie in (0, most = {effect.most}]"
    for name in effect.reads:
        if name not in Conditions.model_fields:
            yield f"it reads '{name}', which is not among the conditions of a scene"
    if not np.all(np.isin(effect.can_act({name: np.array([1.0]) for name in CONDITIONS}), (True, False))):
        yield "can_act does not give a mask"


def is_finite_everywhere(effect: Effect, probe: Probe) -> Iterator[str]:
    """All its numbers are finite at both ends of every range; a scene may be refused with a clear line."""
    names = [f.name for f in fields(effect.params) for _ in ENDS]
    for name, params in zip(names, extreme_params(effect), strict=True):
        if not np.all(np.isfinite(effect_numbers(effect, probe, params, 1.0))):
            yield f"{name} = {getattr(params, name):g} gives a number that is not finite"


def extreme_params(effect: Effect) -> list[Any]:
    """Default parameters with one of them at an end of its range, parameter by parameter."""
    declared = [(f.name, f.metadata[end]) for f in fields(effect.params) for end in ENDS]
    return [replace(effect.params(), **{name: value}) for name, value in declared]


def vanishes_at_no_strength(effect: Effect, probe: Probe) -> Iterator[str]:
    """At strength 0 it does nothing, to the last bit."""
    params = effect.params()
    if effect.place == "scene":
        for scene in SCENES:
            if effect.act(params, 0.0, CONDITIONS, sample_scene(**scene)) != sample_scene(**scene):
                yield "it changes the scene at strength 0"
    elif effect.place == "instrument":
        if any(effect.act(params, 0.0, CONDITIONS, name, 0.3) != 0.3 for name in READINGS):
            yield "it changes a reading at strength 0"
    elif np.any(effect_numbers(effect, probe, params, 0.0) != 0.0):
        yield "it acts at strength 0"


def has_a_sane_reach(effect: Effect, probe: Probe) -> Iterator[str]:
    """A pair effect is silent beyond its reach, which is finite and not negative."""
    if effect.place != "pair" or effect.constants is None:
        return
    reach = effect.reach(effect.constants(effect.params(), 1.0, CONDITIONS), TYPICAL["pair"]["radius_i"])
    if not 0.0 <= reach < float("inf"):
        yield f"its reach is {reach}"
        return
    beyond = TYPICAL["pair"] | {"gap": 1.001 * reach + 1e-9, "stiffness": 0.0}
    for partner in ({}, {"radius_j": 0.0, "radius_effective": 1e-4, "mass_j": 0.0}):
        if np.any(probe(effect.params(), CONDITIONS, **(beyond | partner)) != 0.0):
            yield f"it still pulls beyond its reach of {reach:.4g} m"


def leaves_open_its_own(effect: Effect, probe: Probe) -> Iterator[str]:
    """Numbers that are left to calibration are parameters of the effect, and have a prior with a width."""
    del probe
    for name, sd in effect.uncertain.items():
        if name not in {f.name for f in fields(effect.params)}:
            yield f"uncertain.{name} is none of its parameters"
        elif not 0.0 < sd < float("inf"):
            yield f"uncertain.{name} = {sd} is no standard deviation"


def effect_numbers(effect: Effect, probe: Probe, params: Any, strength: float) -> Any:
    """All numbers that an effect gives in a typical situation."""
    if effect.place == "scene":
        found = [number for scene in SCENES for number in scene_numbers(probe, params, strength, scene)]
        return np.array(found)
    if effect.place == "instrument":
        return np.array([effect.act(params, strength, CONDITIONS, name, 0.3) for name in READINGS])
    situation = TYPICAL[effect.place]
    if effect.grain_state is None:
        return np.ravel(probe(params, CONDITIONS, strength=strength, **situation))
    found = [
        probe(params, CONDITIONS, strength=strength, state_i=state, **situation)
        for state in reached_states(effect, probe, params, strength)
    ]
    return np.concatenate([np.ravel(one) for one in found])


def reached_states(effect: Effect, probe: Probe, params: Any, strength: float) -> list[Any]:
    """States of a grain that has entered, after a long rest, and after a flight that follows it."""
    found = [probe(params, CONDITIONS, strength=strength, state_before=None, **RESTING)]
    for situation in (RESTING, TYPICAL["grain"]):
        found.append(probe(params, CONDITIONS, strength=strength, state_before=found[-1], **situation))
    return found


def scene_numbers(probe: Probe, params: Any, strength: float, sections: dict[str, Any]) -> list[float]:
    """All numbers of a changed scene; none where the effect refuses the scene with a clear line."""
    try:
        scene: Scene = probe(params, CONDITIONS, scene=sample_scene(**sections), strength=strength)
    except BadInput:
        return []
    return list(numbers_in(resolved(scene)))


def numbers_in(tree: Any) -> Iterator[float]:
    """Numbers of nested tables and lists."""
    if isinstance(tree, dict):
        tree = list(tree.values())
    if isinstance(tree, list):
        for branch in tree:
            yield from numbers_in(branch)
    elif isinstance(tree, int | float):
        yield float(tree)


CLAUSES: dict[str, Callable[[Effect, Probe], Iterator[str]]] = {
    "its verification table is right": table_is_right,
    "a parameter wrong by 10 % breaks its table": parameters_are_pinned,
    "its parameters carry unit, meaning and range": parameters_are_documented,
    "it is described": is_described,
    "it is finite at the ends of every range": is_finite_everywhere,
    "it does nothing at strength 0": vanishes_at_no_strength,
    "it is silent beyond its reach": has_a_sane_reach,
    "what it numbers_in to calibration is its own": leaves_open_its_own,
    "its state variables are declared and finite": grain_state_is_sound,
}


def breaches(effect: Effect, bench: Bench) -> list[str]:
    """Everything in which an effect breaks the contract."""
    probe = probe_of(effect, bench)
    return [sentence for clause in CLAUSES.values() for sentence in clause(effect, probe)]
