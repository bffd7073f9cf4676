"""The interface of optional physics: one record per effect, and its numbers for one replica.

An effect lives in one file and acts at one place:

    pair           force [N] between two grains, or a grain and a wall, that touch or are near
    first_contact  whether two grains that begin to overlap touch, or pass through each other
    grain          force [N] and torque [N m] on one grain, from the air around it or from a field
    scene          change of the scene before anything is built: materials, sizes, gravity, air, packing
    instrument     change of the value that a laboratory reads

`strength` multiplies the effect: 0 is bitwise the model without it (it is not even compiled in), 1 the
textbook. Pair, first-contact and grain effects run on the device with a few `constants`, which the host
computes for every replica from parameters, strength and conditions. Conditions of effects on the
device and of instruments come from the scene too: `grain_diameter`, the nominal one [m], `adhesion_scale`,
the factor of a pull over R* where grains are larger than the true ones [1], and under wind `bed_height`,
the height of the undisturbed bed [m], and `density_ratio`, of the grains over the air [1].

A pair or grain effect may have state variables of every grain (internal variables: an age, a charge, a
broken bond). `grain_state` declares them as `params` are, `state_at_entry` gives their values when a grain
enters, and `update_state` advances them at every exchange with the air, once in a fixed number of time steps
(`grain.interval`), one grain at a time. The state of a grain follows it through sorting, checkpoints, and
restored beds. Pair effects read the state of both grains, grain effects that of the one.
"""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from math import inf, isfinite
from numbers import Real
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.errors import BadInput

Conditions = Mapping[str, float]  # stated beside a measurement, in SI units
Constants = dict[str, float]  # numbers that the device reads, by name
Probe = Callable[..., Any]  # (params, conditions, **members of the place) -> result of the effect there
Place = Literal["pair", "first_contact", "grain", "scene", "instrument"]
STRENGTH = "strength"  # reserved among an effect's entries in a scene
STRENGTH_MOST = 100.0  # largest strength that a scene may ask for [1]


def quantity(default: float, unit: str, meaning: str, *, low: float = -inf, high: float = inf) -> Any:
    """Declare a dataclass field holding one number in SI units.

    `unit` is written as in print ("N m-1", "1" for a pure number); `low` and
    `high` bound the values for which the model is claimed to hold.
    """
    return field(default=default, metadata={"unit": unit, "meaning": meaning, "low": low, "high": high})


def check_range(params: Any, effect: str) -> None:
    """Raise ValueError naming the first parameter of an effect outside its range."""
    for f in fields(params):
        value, low, high = getattr(params, f.name), f.metadata["low"], f.metadata["high"]
        if not low <= value <= high:
            unit = "" if f.metadata["unit"] == "1" else f" {f.metadata['unit']}"
            allowed = f"[{low:g}, {high:g}]{unit}"
            raise ValueError(f"effects.{effect}.{f.name} = {value:g}{unit} lies outside {allowed}")


@dataclass(frozen=True)
class Check:
    """One line of a verification table: `got` must equal `want` within tolerance."""

    claim: str
    got: float
    want: float
    rtol: float = 1e-5
    atol: float = 0.0


Checks = Iterator[Check]


@dataclass(frozen=True)
class Effect:
    """Optional physics that a scene can switch on by name.

    `act` is, by place:
        pair           ti.func (constants, pair) -> attraction along the line of centres [N]
        first_contact  ti.func (constants, contact) -> 1 where the two pass, 0 where they touch
        grain          ti.func (constants, grain) -> force [N], torque [N m]
                       and, where there is one,
                       `drag`: ti.func (constants, grain) -> factor of the drag [1]
                       `gust`: ti.func (constants, grain) -> velocity of the wind less its mean [m s-1]
        scene          (params, strength, conditions, scene) -> scene
        instrument     (params, strength, conditions, observable, value) -> value

    With `vector`, a pair effect gives the force on grain i [N]; grain j, or the wall, gets its opposite. With
    a grain state, a pair effect is (constants, pair, state_i, state_j), zeros for a wall; a grain effect is
    (constants, grain, state).
    """

    name: str
    title: str  # one line for lists
    doc: str | None  # module docstring: equation, symbols, units, range, reference
    place: Place
    params: type  # frozen dataclass of `quantity` fields
    act: Callable[..., Any]
    checks: Callable[[Probe], Iterator[Check]]
    constants: Callable[[Any, float, Conditions], Constants] | None = None  # on the device only
    # (constants, largest radius) -> gap [m], pair only; without it an effect acts at contact only
    reach: Callable[[Constants, float], float] = lambda constants, radius: 0.0
    drag: Callable[..., Any] | None = None  # factor of the run's drag, grain only; the air loses what it adds
    gust: Callable[..., Any] | None = None  # velocity that every effect on the grain then feels, grain only
    after_touch: bool = False  # a pair effect between grains that have touched alone (`pair.touched`)
    vector: bool = False  # a pair effect that gives a force vector, not an attraction
    grain_state: type | None = None  # frozen dataclass of `quantity` fields: state variables of a grain
    initial_state: Callable[[Any, float, Conditions], Any] | None = None  # (params, strength, conditions)
    update_state: Callable[..., Any] | None = None  # ti.func (constants, grain, state) -> state
    through_air: bool = False  # acts through the air alone: not at all in a scene without wind
    reads: tuple[str, ...] = ()  # conditions that it reads
    can_act: Callable[[Mapping[str, NDArray[np.float64]]], Any] = lambda conditions: True  # -> mask
    dose: Callable[[Any, Mapping[str, Any]], Any] = lambda params, conditions: 1.0  # of its strength [1]
    uncertain: Mapping[str, float] = field(default_factory=dict)  # own numbers to calibrate -> prior sd of ln
    prior_scale: float = 1.0  # of strength: half-normal scale that the literature supports [1]
    most: float = 3.0  # largest strength that is physical [1]
    expected: Mapping[str, int] = field(default_factory=dict)  # observable -> +1 up, -1 down: literature
    mechanism: str = ""  # whose dose is strength times `dose`: a law found beyond the list of effects

    def __post_init__(self) -> None:
        """Raise ValueError for a grain state that nothing updates, or at a place without grains."""
        if (self.grain_state is None) != (self.update_state is None):
            raise ValueError(f"effect '{self.name}': grain_state and update_state go together")
        places = {"grain_state": ("pair", "grain"), "drag": ("grain",), "gust": ("grain",)}
        for name, allowed in places.items():
            if getattr(self, name) is not None and self.place not in allowed:
                raise ValueError(f"effect '{self.name}': place {self.place} has no {name}")


def effect_of(module: str, title: str, place: Place, act: Callable[..., Any], **entries: Any) -> Effect:
    """Effect of the file of a module: name of the file, its docstring, its `Params`, and entries of Effect.

    What the file defines under the name of an entry (`checks`, `constants`, `reach`, ...) need not be stated.
    """
    file = sys.modules[module]
    members = {"name": Path(str(file.__file__)).stem, "doc": file.__doc__, "params": file.Params}
    members |= {f.name: getattr(file, f.name) for f in fields(Effect) if hasattr(file, f.name)}
    return Effect(title=title, place=place, act=act, **members | entries)


@dataclass(frozen=True)
class ReplicaEffect:
    effect: Effect
    constants: Constants
    reach: float  # gap beyond which it vanishes [m]
    initial_state: Constants = field(default_factory=dict)  # of a grain that enters


def read_effect_entries(effect: Effect, entries: Mapping[str, float]) -> tuple[Any, float]:
    """Parameters and strength from a scene's entries. Raises ValueError naming what is out of range."""
    strength = float(entries.get(STRENGTH, 1.0))
    if not 0.0 <= strength <= STRENGTH_MOST:
        raise ValueError(f"effects.{effect.name}.strength = {strength} lies outside [0, {STRENGTH_MOST:g}]")
    params = effect.params(**{name: value for name, value in entries.items() if name != STRENGTH})
    check_range(params, effect.name)
    return params, strength


def strength_warning(effect: Effect, strength: float) -> str | None:
    """What to know about a strength beyond the largest that is physical; None within."""
    if strength <= effect.most:
        return None
    words = f"is more than {effect.most:g}, the largest that its literature supports"
    return f"effects.{effect.name}.{STRENGTH} = {strength:g} {words}"


def parameter_names(effect: Effect) -> tuple[str, ...]:
    """Entries that a scene may give for an effect."""
    return (STRENGTH, *(f.name for f in fields(effect.params)))


def first_reference(effect: Effect) -> str:
    """First reference in an effect's docstring; empty without one."""
    _, _, works = (effect.doc or "").partition("Reference:")
    return " ".join(works.split()).partition(";")[0].rstrip(".")


def replica_effect(
    effect: Effect, params: Any, strength: float, conditions: Conditions, radius: float
) -> ReplicaEffect:
    """Constants and reach of a device effect in one replica; `radius` is that of its largest grain [m]."""
    assert effect.constants is not None
    constants = effect.constants(params, strength, conditions)
    numbers = constants.values() if isinstance(constants, dict) else (None,)
    if not all(isinstance(number, Real) and isfinite(number) for number in numbers):
        words = f"constants must give a dict of finite numbers by name, not {constants!r}"
        raise BadInput(f"effects.{effect.name}: {words}")
    start = state_at_entry(effect, params, strength, conditions)
    return ReplicaEffect(effect, constants, effect.reach(constants, radius), start)


def longest_effect_reaches(effects: Sequence[ReplicaEffect]) -> tuple[float, float]:
    """Longest gaps across which effects act, between any grains and some that have not touched [m]."""
    free = (one.reach for one in effects if not one.effect.after_touch)
    return max((one.reach for one in effects), default=0.0), max(free, default=0.0)


def state_at_entry(effect: Effect, params: Any, strength: float, conditions: Conditions) -> Constants:
    """State variables of a grain that enters; empty for an effect without them."""
    if effect.grain_state is None:
        return {}
    begin = effect.initial_state
    return asdict(effect.grain_state() if begin is None else begin(params, strength, conditions))


def pair_struct_type() -> Any:
    """Struct that a pair effect reads: two grains, or a grain and a wall."""
    from taichi_erosion.core.ti import ti  # most of what knows effects needs no compiler

    real3 = ti.types.vector(3, float)
    return ti.types.struct(
        gap=float,  # surface distance [m]; negative where they overlap
        radius_i=float,  # [m]
        radius_j=float,  # [m]; 0 marks a wall
        radius_effective=float,  # R_i R_j / (R_i + R_j), of a wall R_i [m]
        mass_i=float,  # [kg]
        mass_j=float,  # [kg]; 0 marks a wall
        closing_speed=float,  # at which the gap shrinks [m s-1]
        stiffness=float,  # of the elastic contact, dF/d(overlap); 0 where they do not touch [N m-1]
        touched=float,  # 1 where they have touched since they were last out of reach, else 0
        normal=real3,  # unit vector from grain j, or from the wall, to grain i [1]
        offset=real3,  # centre of grain i less that of grain j; of a wall: the centre of grain i [m]
        period=real3,  # of the box [m], 0 where it is open
    )


def first_contact_struct_type() -> Any:
    """Struct that a first-contact effect reads: two grains that begin to overlap."""
    from taichi_erosion.core.ti import ti

    return ti.types.struct(
        height=float,  # of the centre of the lower one, in the coordinates of the scene [m]
        depth=float,  # overlap over the effective radius [1]
        chance=float,  # random number in [0, 1) of this pair, constant in time [1]
    )


def compile_grain_type(drag_law: Any) -> Any:
    """Struct that a grain effect reads: one grain and the air around it.

    `grain.drag(slip)` is the drag [N] of the run's law at a slip velocity, air less grain [m s-1], times the
    factors of effects. The law:
    ti.func (slip speed, radius, mass, air density, kinematic viscosity, void fraction) -> drag rate [s-1].
    """
    from taichi_erosion.core.ti import ti

    real3 = ti.types.vector(3, float)

    @ti.func
    def drag(grain: ti.template(), slip):
        viscosity = grain.air_viscosity / grain.air_density
        # the law of a unit mass: a rate is drag over mass
        rate = drag_law(slip.norm(), grain.radius, 1.0, grain.air_density, viscosity, grain.void_fraction)
        return grain.drag_factor * rate * slip

    return ti.types.struct(
        position=real3,  # [m]
        velocity=real3,  # [m s-1]
        spin=real3,  # [rad s-1]
        radius=float,  # [m]
        mass=float,  # [kg]
        air_velocity=real3,  # undisturbed, at the centre, with gusts [m s-1]
        air_shear=float,  # vertical gradient of the streamwise velocity, with gusts [s-1]
        air_density=float,  # [kg m-3]
        air_viscosity=float,  # dynamic [Pa s]
        friction_velocity=float,  # of the driving stress [m s-1]
        void_fraction=float,  # of the air around the grain [1]
        height=float,  # above the undisturbed bed surface [m]
        period=real3,  # of the box [m], 0 where it is open
        drag_factor=float,  # of the law of drag, product of the effects' [1]
        noise=real3,  # three standard normal numbers of this grain and exchange, fixed by the seed [1]
        interval=float,  # time until the next exchange with the air [s]
        time=float,  # since the start [s]
        chance=float,  # random number in [0, 1) of this replica, fixed by the seed [1]
        __struct_methods={"drag": drag},
    )
