"""The contract that every effect keeps, and the check of one effect against it.

Each clause gives one sentence for every breach of it, and nothing for an effect that keeps it. The device
must have been started for clauses; `examine_effect` starts it.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from difflib import get_close_matches
from math import inf, isclose, isfinite
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from taichi_erosion.core import effect_file
from taichi_erosion.core.device import start_device, stop_device
from taichi_erosion.core.effect import Check, Effect, Probe, check_range
from taichi_erosion.core.effect_probe import TYPICAL, Bench, allocate_bench, falsify_parameter, make_probe
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Numerics
from taichi_erosion.scene import Scene, resolve
from taichi_erosion.scene.change import sample_scene
from taichi_erosion.scene.schema.conditions import OF_SCENE, Conditions
from taichi_erosion.scene.schema.fields import all_numbers_in
from taichi_erosion.scene.schema.units import UnknownUnit, parse_unit

LEAST_CHECKS = 3
LIKE = 0.8  # likeness of names from which one is taken for a misspelling of the other [1]
WRONG = 1.1  # factor by which a parameter is falsified
# of a laboratory that states every condition
CONDITIONS = {"moisture": 0.02, "temperature": 300.0, "relative_humidity": 0.3, "pressure": 9e4}
CONDITIONS |= {"altitude": 1000.0, "slope": 5.0, "diameter": 2e-4, "angularity": 0.5}
CONDITIONS |= {"friction_velocity": 0.35}
WIND = {"length": 0.02, "width": 0.01, "height": 0.05}
UNIT_OF = "unit of "  # first words of a unit that follows another number, as the reading of an instrument
RESTING = TYPICAL["grain"] | {"velocity": (0.0, 0.0, 0.0), "spin": (0.0, 0.0, 0.0), "interval": 1.0}
READINGS = ("repose_angle", "threshold_u_star", "fluid_threshold_stress", "flux", "pile_height")


def is_check_right(check: Check) -> bool:
    return isclose(check.got, check.want, rel_tol=check.rtol, abs_tol=check.atol)


@dataclass
class RecordedConditions(Mapping[str, Any]):
    """Conditions that keep the names under which they were read."""

    values_by_name: Mapping[str, Any]
    read: set[str] = field(default_factory=set)

    def __getitem__(self, name: str) -> Any:
        self.read.add(name)
        return self.values_by_name[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.values_by_name)

    def __len__(self) -> int:
        return len(self.values_by_name)


def conditions_to_declare(effect: Effect) -> list[str]:
    """Conditions that an effect reads and that a scene has to declare."""
    return [name for name in effect.reads if name not in Conditions.model_fields]


def sample_conditions(effect: Effect) -> dict[str, float]:
    """A laboratory that states every condition, those that only this effect reads among them."""
    return CONDITIONS | dict.fromkeys(conditions_to_declare(effect), 1.0)


def sample_sections(effect: Effect) -> list[dict[str, Any]]:
    """Sections of sample scenes without and with wind."""
    extra = {name: {"unit": "1", "value": 1.0} for name in conditions_to_declare(effect)}
    conditions = CONDITIONS | ({"extra": extra} if extra else {})
    return [{"conditions": conditions}, {"conditions": conditions, "wind": WIND}]


def sample_row(effect: Effect) -> dict[str, Any]:
    """One row of a table that states every condition."""
    return {name: np.array([1.0]) for name in sample_conditions(effect)}


def extreme_params(effect: Effect) -> Iterator[tuple[str, Any]]:
    """Parameters with the one of that name at an end of its range and defaults besides."""
    for f in fields(effect.params):
        for end in ("low", "high"):
            yield f.name, replace(effect.params(), **{f.name: f.metadata[end]})


def table_faults(effect: Effect, probe: Probe) -> Iterator[str]:
    """The verification table has at least three lines, and all are right."""
    table = list(effect.checks(probe))
    if len(table) < LEAST_CHECKS:
        yield f"its table has {len(table)} lines; at least {LEAST_CHECKS} are needed"
    yield from (f"{c.claim}: got {c.got:.6g}, want {c.want:.6g}" for c in table if not is_check_right(c))


def unpinned_parameters(effect: Effect, probe: Probe) -> Iterator[str]:
    """Making any one parameter wrong by 10 % breaks some line of the table."""
    for f in fields(effect.params):
        if all(is_check_right(check) for check in effect.checks(falsify_parameter(probe, f.name, WRONG))):
            yield f"no line of its table notices that {f.name} is wrong by 10 %"


def parameter_faults(effect: Effect, probe: Probe) -> Iterator[str]:
    """Parameters carry unit, meaning and a finite range that holds their default."""
    for f in fields(effect.params):
        problems = list(declaration_problems(f))
        yield from problems
        if not problems and not (isfinite(f.metadata["low"]) and isfinite(f.metadata["high"])):
            yield f"{f.name} has no range"
    try:
        check_range(effect.params(), effect.name)
    except ValueError as error:
        yield str(error)


def declaration_problems(f: Any) -> Iterator[str]:
    """A number without meaning, or in a unit that is not known or not of SI; an angle may be in degrees."""
    unit = f.metadata.get("unit", "")
    if f.default is MISSING or not (f.metadata.get("meaning") and unit):
        yield f"{f.name} is declared without unit or meaning; use quantity"
    elif not unit.startswith(UNIT_OF):
        try:
            if parse_unit(unit).factor != 1.0 and unit != "deg":
                yield f"{f.name} is declared in {unit}; numbers of an effect are in SI units, or in deg"
        except UnknownUnit as error:
            hint = error.hint or "write for example N m-1 or 1"
            yield f"{f.name} has the unit '{unit}', which is not known; {hint}"


def grain_state_faults(effect: Effect, probe: Probe) -> Iterator[str]:
    """State variables of grains carry unit and meaning, begin as declared, and stay finite."""
    if effect.grain_state is None:
        return
    for f in fields(effect.grain_state):
        yield from (f"grain_state.{problem}" for problem in declaration_problems(f))
    for _, params in (("", effect.params()), *extreme_params(effect)):
        for state in states_of_history(effect, probe, params, 1.0):
            if not np.all(np.isfinite(list(asdict(state).values()))):
                yield f"with {params} a state variable is not finite"


def description_faults(effect: Effect, probe: Probe) -> Iterator[str]:
    """Docstring with a reference and what strength does; title, prior, conditions that exist."""
    lacking = (word for word in ("Reference:", "trength", "Holds") if word not in (effect.doc or ""))
    yield from (f"its docstring lacks '{word}'" for word in lacking)
    if not effect.title:
        yield "it has no title"
    if not 0.0 < effect.prior_scale <= effect.most:
        yield f"prior_scale = {effect.prior_scale} must lie in (0, most = {effect.most}]"
    for name in conditions_to_declare(effect):
        if near := get_close_matches(name, Conditions.model_fields, n=1, cutoff=LIKE):
            meaning = f"did you mean '{near[0]}'?"
            yield f"it reads '{name}', which is not among the conditions of a scene; {meaning}"
    if not np.all(np.isin(effect.can_act(sample_row(effect)), (True, False))):
        yield "can_act does not give a mask"


def undeclared_reads(effect: Effect, probe: Probe) -> Iterator[str]:
    """Every condition that it reads stands in `reads`: a study sets no other one in its runs."""
    conditions, row = RecordedConditions(sample_conditions(effect)), RecordedConditions(sample_row(effect))
    params = effect.params()
    effect.can_act(row)
    effect.dose(params, conditions)
    if effect.constants is not None:
        effect.constants(params, 1.0, conditions)
    for sections in sample_sections(effect) if effect.place == "scene" else ():
        with suppress(BadInput):  # the scene is refused
            effect.act(params, 1.0, conditions, sample_scene(**sections))
    for name in READINGS if effect.place == "instrument" else ():
        effect.act(params, 1.0, conditions, name, 0.3)
    for name in sorted((conditions.read | row.read) - {*effect.reads, *OF_SCENE}):
        yield f"it reads the condition '{name}', which its entry reads = (...) does not name"


def infinite_numbers(effect: Effect, probe: Probe) -> Iterator[str]:
    """All its numbers are finite at both ends of every range; a scene may be refused with a clear line."""
    for name, params in extreme_params(effect):
        if not np.all(np.isfinite(effect_numbers(effect, probe, params, 1.0))):
            yield f"{name} = {getattr(params, name):g} gives a number that is not finite"


def leftovers_at_no_strength(effect: Effect, probe: Probe) -> Iterator[str]:
    """At strength 0 it does nothing, to the last bit."""
    params, conditions = effect.params(), sample_conditions(effect)
    if effect.place == "scene":
        scenes = [sample_scene(**sections) for sections in sample_sections(effect)]
        if any(effect.act(params, 0.0, conditions, scene) != scene for scene in scenes):
            yield "it changes the scene at strength 0"
    elif effect.place == "instrument":
        if any(effect.act(params, 0.0, conditions, name, 0.3) != 0.3 for name in READINGS):
            yield "it changes a reading at strength 0"
    elif np.any(effect_numbers(effect, probe, params, 0.0) != 0.0):
        yield "it acts at strength 0"


def reach_faults(effect: Effect, probe: Probe) -> Iterator[str]:
    """A pair effect is silent beyond its reach, which is finite and not negative."""
    if effect.place != "pair" or effect.constants is None:
        return
    constants = effect.constants(effect.params(), 1.0, sample_conditions(effect))
    reach = effect.reach(constants, TYPICAL["pair"]["radius_i"])
    if not 0.0 <= reach < inf:
        yield f"its reach is {reach}"
        return
    beyond = TYPICAL["pair"] | {"gap": 1.001 * reach + 1e-9, "stiffness": 0.0}
    for partner in ({}, {"radius_j": 0.0, "radius_effective": 1e-4, "mass_j": 0.0}):
        if np.any(probe(effect.params(), sample_conditions(effect), **(beyond | partner)) != 0.0):
            yield f"it still pulls beyond its reach of {reach:.4g} m"


def open_number_faults(effect: Effect, probe: Probe) -> Iterator[str]:
    """Numbers that are left to calibration are parameters of the effect, and have a prior with a width."""
    for name, sd in effect.uncertain.items():
        if name not in {f.name for f in fields(effect.params)}:
            yield f"uncertain.{name} is none of its parameters"
        elif not 0.0 < sd < inf:
            yield f"uncertain.{name} = {sd} is no standard deviation"


def effect_numbers(effect: Effect, probe: Probe, params: Any, strength: float) -> Any:
    """All numbers that an effect gives in a typical situation."""
    conditions = sample_conditions(effect)
    if effect.place == "scene":
        numbers = [scene_numbers(probe, params, strength, sections) for sections in sample_sections(effect)]
        return np.concatenate(numbers)
    if effect.place == "instrument":
        cells = (effect.act(params, strength, conditions, name, 0.3) for name in READINGS)
        return np.array([effect_file.require_number(effect, one) for one in cells])
    members = TYPICAL[effect.place] | {"strength": strength}
    if effect.grain_state is None:
        return np.ravel(probe(params, conditions, **members))
    states = states_of_history(effect, probe, params, strength)
    return np.concatenate([np.ravel(probe(params, conditions, state_i=state, **members)) for state in states])


def states_of_history(effect: Effect, probe: Probe, params: Any, strength: float) -> list[Any]:
    """States of a grain that has entered, after a long rest, and after a flight that follows it."""
    states: list[Any] = [None]
    for situation in (RESTING, RESTING, TYPICAL["grain"]):
        before = {"strength": strength, "state_before": states[-1]}
        states.append(probe(params, sample_conditions(effect), **before, **situation))
    return states[1:]


def scene_numbers(probe: Probe, params: Any, strength: float, sections: dict[str, Any]) -> list[float]:
    """All numbers of a changed scene; none where the effect refuses the scene with a clear line."""
    try:
        before = sample_scene(**sections)
        scene: Scene = probe(params, before.conditions.values_in_si(), scene=before, strength=strength)
    except BadInput:
        return []
    if not isinstance(scene, Scene):
        raise TypeError(f"act gives {scene!r}, not the scene")
    return list(all_numbers_in(resolve(scene)))


CLAUSES: dict[str, Callable[[Effect, Probe], Iterator[str]]] = {
    "its verification table is right": table_faults,
    "a parameter wrong by 10 % breaks its table": unpinned_parameters,
    "its parameters carry unit, meaning and range": parameter_faults,
    "it is described": description_faults,
    "it names the conditions that it reads": undeclared_reads,
    "it is finite at the ends of every range": infinite_numbers,
    "it does nothing at strength 0": leftovers_at_no_strength,
    "it is silent beyond its reach": reach_faults,
    "what it leaves to calibration is its own": open_number_faults,
    "its state variables are declared and finite": grain_state_faults,
}


def usable_probe(effect: Effect, bench: Bench) -> Probe:
    """Probe of an effect that can act with its default parameters. Raises BadInput where it cannot."""
    with effect_file.failures_of(effect, "act"):
        probe = make_probe(effect, bench)
        effect_numbers(effect, probe, effect.params(), 1.0)
    return probe


def breaches(effect: Effect, probe: Probe) -> list[str]:
    """Everything in which an effect that can act breaks the contract; an error in a clause is a breach."""
    faults: list[str] = []
    for name, clause in CLAUSES.items():
        try:
            faults += clause(effect, probe)
        except Exception as error:
            message = f"{name}: cannot be told{effect_file.line_of(error)}: {effect_file.error_text(error)}"
            faults.append(effect_file.compile_failure_text(error) or message)
    return list(dict.fromkeys(faults))


@dataclass(frozen=True)
class Examination:
    """What a check of one effect found."""

    table: tuple[Check, ...]  # verification table; empty where it cannot be computed
    can_act: bool
    breaches: tuple[str, ...]  # everything in which it breaks the contract, or why it cannot act
    seconds: float  # that the check took


def examine_effect(effect: Effect) -> Examination:
    """Check of one effect against the contract, on a device that is started for it and released."""
    started, table = perf_counter(), ()
    start_device(Numerics(threads=1))
    try:
        probe = usable_probe(effect, allocate_bench())
        with suppress(Exception):  # the contract names what is missing
            table = tuple(effect.checks(probe))
        return Examination(table, True, tuple(breaches(effect, probe)), perf_counter() - started)
    except BadInput as error:
        return Examination(table, False, error.faults, perf_counter() - started)
    finally:
        stop_device()


def examine_file(file: effect_file.EffectFile) -> dict[str, Any]:
    """Name, breaches and time [s] of the check of the effect of a file. Raises BadInput if it cannot act."""
    effect = effect_file.effect_in(file)
    examination = examine_effect(effect)
    if not examination.can_act:
        raise BadInput(f"{file}: effect '{effect.name}' cannot act: {examination.breaches[0]}")
    checked = {"breaches": list(examination.breaches), "wall_s": examination.seconds}
    return {"effect": effect.name, "file": str(file)} | checked


def examine_effect_files(paths: Iterable[Path]) -> list[dict[str, Any]]:
    """Checks of effect files before a session. Raises BadInput where an effect cannot act."""
    return [examine_file(file) for file in effect_file.read_effect_files(paths)]


def check_sentence(examination: Mapping[str, Any]) -> str:
    subject = f"effect '{examination['effect']}' of {examination['file']}"
    if not examination["breaches"]:
        return f"{subject} compiles and keeps the contract of effects ({examination['wall_s']:.1f} s)"
    first, *others = examination["breaches"]
    rest = f"{len(others)} more: `effects {examination['effect']} --effect {examination['file']}` lists them"
    return f"{subject} breaks the contract of effects: {first}{f' (and {rest})' if others else ''}"
