"""Asking an effect alone what it does at one place: with this its verification table is made.

A probe of a pair effect gives its attraction, of a whole one its force [N]; of a meeting effect 1 where two
grains pass; of a grain effect its force [N] and torque [N m]; of a scene effect the scene that it makes of
`scene`; of an instrument the value that it reads instead of `value`.

Where the effect has a memory, `mine` and `other` are what it remembers of the grains, each as it begins where
left out. With `before=MEMORY` and members of a grain the probe gives the memory after a look at that grain;
`before=None` stands for a memory as it begins.
The device must have been started for effects that act on it.
"""

from dataclasses import asdict, dataclass, fields, replace
from math import pi
from typing import Any

import numpy as np

from taichi_erosion.core.effect import (
    Acting,
    Conditions,
    Effect,
    Probe,
    begun,
    grain_type,
    meeting_type,
    pair_type,
)
from taichi_erosion.core.effect_device import Bound, bind, force_of, passes, pull_of, push_of, update_memory
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import download, read, upload

PAIR = {  # two grains of 0.2 mm in contact
    "gap": 0.0,
    "radius_i": 1e-4,
    "radius_j": 1e-4,
    "radius_effective": 5e-5,
    "mass_i": 1e-8,
    "mass_j": 1e-8,
    "closing_speed": 0.1,
    "stiffness": 100.0,
    "met": 1.0,
    "normal": (1.0, 0.0, 0.0),
    "offset": (2e-4, 0.0, 0.0),
    "period": (0.0, 0.0, 0.0),
}
GRAIN = {  # a grain of 0.2 mm in the wind above a bed
    "position": (0.01, 0.002, 0.005),
    "velocity": (1.0, 0.1, -0.2),
    "spin": (10.0, 300.0, -20.0),
    "radius": 1e-4,
    "mass": 1e-8,
    "air_velocity": (3.0, 0.0, 0.0),
    "air_shear": 300.0,
    "air_density": 1.2,
    "air_viscosity": 1.8e-5,
    "friction_velocity": 0.3,
    "void_fraction": 1.0,
    "height": 0.005,
    "period": (0.0, 0.0, 0.0),
    "noise": (0.3, -0.5, 1.1),
    "interval": 1e-4,
    "time": 0.5,
    "chance": 0.37,
}
MEETING = {"height": 0.01, "depth": 0.01, "chance": 0.37}  # high in the air, at first touch
MINE, OTHER, PLACES = 0, 1, 2  # of two grains whose memory an effect reads
TYPICAL = {"pair": PAIR, "meeting": MEETING, "grain": GRAIN}


@ti.kernel
def feel_pair(
    # in
    bound: ti.template(),
    pairs: ti.template(),
    # out
    pull_out: ti.template(),
    force_out: ti.template(),
):
    for i in pull_out:
        pair = pairs[i]
        other = ti.select(pair.radius_j > 0.0, OTHER, bound.nobody)
        pull_out[i] = pull_of(bound, 0, pair, MINE, other)
        force_out[i] = force_of(bound, 0, pair, MINE, other)


@ti.kernel
def feel_meeting(
    # in
    bound: ti.template(),
    meetings: ti.template(),
    # out
    free_out: ti.template(),
):
    for i in free_out:
        meeting = meetings[i]
        free_out[i] = ti.cast(passes(bound, 0, meeting), float)


@ti.kernel
def feel_grain(
    # in
    bound: ti.template(),
    grains: ti.template(),
    # out
    force_out: ti.template(),
    torque_out: ti.template(),
):
    for i in force_out:
        grain = grains[i]
        force_out[i], torque_out[i] = push_of(bound, 0, grain, MINE)


@ti.kernel
def look_at(
    # in
    grains: ti.template(),
    # out
    bound_out: ti.template(),
):
    for i in grains:
        grain = grains[i]
        update_memory(bound_out, 0, grain, MINE)


@dataclass(frozen=True, eq=False)
class Bench:
    """Fields that all device probes share, so that their kernels are built once."""

    pair: Any  # struct of one pair
    meeting: Any  # struct of one meeting
    grain: Any  # struct of one grain
    pull: Any  # [N], or whether two grains pass [1]
    force: Any  # vec3 [N]
    torque: Any  # vec3 [N m]


@ti.func
def stokes_drag(slip, radius, mass, density, viscosity, void):
    """Rate of drag on a sphere in creeping flow [s-1]."""
    return 6.0 * pi * density * viscosity * radius / mass


def make_bench(drag_law: Any = stokes_drag) -> Bench:
    """Fields of one pair, meeting and grain on the device, which must have been started."""
    force, torque = (ti.Vector.field(3, float, shape=1) for _ in range(2))
    kinds = (pair_type(), meeting_type(), grain_type(drag_law))
    pair, meeting, grain = (kind.field(shape=1) for kind in kinds)
    return Bench(pair, meeting, grain, ti.field(float, shape=1), force, torque)


def probe_of(effect: Effect, bench: Bench) -> Probe:
    """Function (params, conditions, strength=1, **members of the place) -> what the effect does there."""
    if effect.place == "scene":
        return lambda params, conditions, scene, strength=1.0: effect.act(params, strength, conditions, scene)
    if effect.place == "instrument":
        return lambda params, conditions, observable, value, strength=1.0: effect.act(
            params, strength, conditions, observable, value
        )
    return device_probe(effect, bench)


def device_probe(effect: Effect, bench: Bench) -> Probe:
    """Probe of an effect on the device; members that are not named are 0."""
    assert effect.constants is not None
    constants = effect.constants
    start = begun(effect, effect.params(), 1.0, {})
    bound = bind(effect.place, [[Acting(effect, constants(effect.params(), 1.0, {}), 0.0, start)]], PLACES)

    def probe(params: Any, conditions: Conditions, strength: float = 1.0, **members: Any) -> Any:
        numbers = constants(params, strength, conditions)
        upload([(getattr(bound.constants[0], name), [value]) for name, value in numbers.items()])
        looked = "before" in members
        first = members.pop("before", None) if looked else members.pop("mine", None)
        if effect.memory is not None:
            fresh = effect.memory(**begun(effect, params, strength, conditions))
            set_memory(bound, MINE, first or fresh)
            set_memory(bound, OTHER, members.pop("other", None) or fresh)
        place = bench.grain if looked else getattr(bench, effect.place)
        upload([(parts(place)[name], [value]) for name, value in (silent(place) | members).items()])
        return after_look(effect, bound, bench) if looked else acted(effect, bound, bench)

    return probe


def silent(place: Any) -> dict[str, Any]:
    """Zeros for all members of a struct field."""
    return {name: np.zeros(value.n if hasattr(value, "n") else 1) for name, value in parts(place).items()}


def acted(effect: Effect, bound: Bound, bench: Bench) -> Any:
    """What an effect does to what lies in the bench."""
    if effect.place == "grain":
        feel_grain(bound, bench.grain, bench.force, bench.torque)
        return tuple(read(answer)[0].astype(np.float64) for answer in (bench.force, bench.torque))
    if effect.place == "pair":
        feel_pair(bound, bench.pair, bench.pull, bench.force)
    else:
        feel_meeting(bound, bench.meeting, bench.pull)
    return read(bench.force)[0].astype(np.float64) if effect.whole else float(read(bench.pull)[0])


def set_memory(bound: Bound, place: int, memory: Any) -> None:
    """Write what is remembered of one place."""
    upload([(getattr(bound.memories[0], name), [value]) for name, value in asdict(memory).items()], place)


def after_look(effect: Effect, bound: Bound, bench: Bench) -> Any:
    """What an effect remembers after a look at the grain in the bench."""
    assert effect.memory is not None
    look_at(bench.grain, bound)
    names = [f.name for f in fields(effect.memory)]
    numbers = download([getattr(bound.memories[0], name) for name in names], MINE, 1)
    return effect.memory(**{name: float(one[0]) for name, one in zip(names, numbers, strict=True)})


def parts(place: Any) -> dict[str, Any]:
    """Fields of the members of a struct field, by name."""
    return {name: getattr(place, name) for name in place.keys}


def falsified(probe: Probe, name: str, factor: float) -> Probe:
    """The same probe with one parameter made wrong by a factor."""

    def wrong(params: Any, conditions: Conditions, **members: Any) -> Any:
        return probe(replace(params, **{name: factor * getattr(params, name)}), conditions, **members)

    return wrong
