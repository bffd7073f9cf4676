"""Evaluation of one effect at one place, from which its verification table is made.

The probe of a pair effect gives its attraction, or its force vector [N]; of a first-contact effect 1 where
two grains pass; of a grain effect force [N], what it adds to the drag included, and torque [N m]; of a
scene effect the changed `scene`; of an instrument the value that is read instead of `value`.

For an effect with a grain state, `state_i` and `state_j` set the states of the grains; with `state_before`
and members of a grain the probe gives the state after one exchange interval. A state that is None or left
out is the initial one. The device must have been started for effects that act on it.
"""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from math import pi
from typing import Any

import numpy as np

from taichi_erosion.core import effect_device
from taichi_erosion.core.effect import (
    Conditions,
    Effect,
    Probe,
    compile_grain_type,
    first_contact_struct_type,
    pair_struct_type,
    replica_effect,
    state_at_entry,
)
from taichi_erosion.core.effect_file import failures_of
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record, download, download_field, upload

# two grains of 0.2 mm in contact
PAIR = {"radius_i": 1e-4, "radius_j": 1e-4, "radius_effective": 5e-5, "mass_i": 1e-8, "mass_j": 1e-8}
PAIR |= {"gap": 0.0, "closing_speed": 0.1, "stiffness": 100.0, "touched": 1.0, "normal": (1.0, 0.0, 0.0)}
PAIR |= {"offset": (2e-4, 0.0, 0.0), "period": (0.0, 0.0, 0.0)}
# a grain of 0.2 mm in the wind above a bed
GRAIN = {"position": (0.01, 0.002, 0.005), "velocity": (1.0, 0.1, -0.2), "spin": (10.0, 300.0, -20.0)}
GRAIN |= {"radius": 1e-4, "mass": 1e-8, "height": 0.005, "period": (0.0, 0.0, 0.0), "void_fraction": 1.0}
GRAIN |= {"air_velocity": (3.0, 0.0, 0.0), "air_shear": 300.0, "air_density": 1.2, "air_viscosity": 1.8e-5}
GRAIN |= {"friction_velocity": 0.3, "noise": (0.3, -0.5, 1.1), "interval": 1e-4, "time": 0.5, "chance": 0.37}
FIRST_CONTACT = {"height": 0.01, "depth": 0.01, "chance": 0.37}  # high in the air, at first touch
PLACE_I, PLACE_J, PLACES = 0, 1, 2  # places of two grains whose state an effect reads
TYPICAL = {"pair": PAIR, "first_contact": FIRST_CONTACT, "grain": GRAIN}


@device_record
class Bench:
    """Fields that all device probes share, so that their kernels are built once."""

    pair: Any  # struct of one pair
    first_contact: Any  # struct of one pair that begins to overlap
    grain: Any  # struct of one grain
    scalar: Any  # attraction [N], or whether two grains pass [1]
    force: Any  # vec3 [N]
    torque: Any  # vec3 [N m]


@ti.func
def stokes_drag(slip, radius, mass, density, viscosity, void):
    """Rate of drag on a sphere in creeping flow [s-1]."""
    return 6.0 * pi * density * viscosity * radius / mass


def allocate_bench(drag_law: Any = stokes_drag) -> Bench:
    """Fields of one pair, first contact and grain on the device, which must have been started."""
    force, torque = (ti.Vector.field(3, float, shape=1) for _ in range(2))
    kinds = (pair_struct_type(), first_contact_struct_type(), compile_grain_type(drag_law))
    pair, contact, grain = (kind.field(shape=1) for kind in kinds)
    return Bench(pair, contact, grain, ti.field(float, shape=1), force, torque)


@ti.kernel
def evaluate_bench_pair(
    effects: ti.template(), pairs: ti.template(), attraction_out: ti.template(), force_out: ti.template()
):
    for i in attraction_out:
        pair = pairs[i]
        j = ti.select(pair.radius_j > 0.0, PLACE_J, effects.wall_place)
        attraction_out[i] = effect_device.total_attraction(effects, 0, pair, PLACE_I, j)
        force_out[i] = effect_device.total_vector_force(effects, 0, pair, PLACE_I, j)


@ti.kernel
def evaluate_bench_contact(effects: ti.template(), contacts: ti.template(), passes_out: ti.template()):
    for i in passes_out:
        contact = contacts[i]
        passes_out[i] = ti.cast(effect_device.any_lets_pass(effects, 0, contact), float)


@ti.kernel
def evaluate_bench_grain(
    effects: ti.template(), grains: ti.template(), force_out: ti.template(), torque_out: ti.template()
):
    for i in force_out:
        grain = grains[i]
        grain.drag_factor = 1.0
        bare = grain.drag(grain.air_velocity - grain.velocity)
        grain.drag_factor = effect_device.total_drag_factor(effects, 0, grain)
        drag = (grain.drag_factor - 1.0) * bare
        if ti.static(effects.any_gust):
            drag += effect_device.add_gusts(effects, 0, grain)
        force, torque = effect_device.total_grain_force(effects, 0, grain, PLACE_I)
        if ti.static(effects.any_drag or effects.any_gust):
            force += drag
        force_out[i], torque_out[i] = force, torque


@ti.kernel
def advance_bench_state(grains: ti.template(), effects_out: ti.template()):
    for i in grains:
        grain = grains[i]
        effect_device.advance_states(effects_out, 0, grain, PLACE_I)


def make_probe(effect: Effect, bench: Bench) -> Probe:
    """Function (params, conditions, strength=1, **members of the place) -> result of the effect there."""
    if effect.place == "scene":
        return lambda params, conditions, scene, strength=1.0: effect.act(params, strength, conditions, scene)
    if effect.place == "instrument":
        return lambda params, conditions, observable, value, strength=1.0: effect.act(
            params, strength, conditions, observable, value
        )
    return make_device_probe(effect, bench)


def make_device_probe(effect: Effect, bench: Bench) -> Probe:
    """Probe of an effect on the device; members that are not named are 0."""
    assert effect.constants is not None
    constants = effect.constants
    anywhere = defaultdict[str, float](lambda: 1.0)  # conditions: the names of the constants alone count here
    with failures_of(effect, "constants"):
        effects = effect_device.bind(
            effect.place, [[replica_effect(effect, effect.params(), 1.0, anywhere, 0.0)]], PLACES
        )

    def probe(params: Any, conditions: Conditions, strength: float = 1.0, **members: Any) -> Any:
        numbers = constants(params, strength, conditions)
        upload([(getattr(effects.constants[0], name), [value]) for name, value in numbers.items()])
        advances = "state_before" in members
        state_i = members.pop("state_before" if advances else "state_i", None)
        if effect.grain_state is not None:
            fresh = effect.grain_state(**state_at_entry(effect, params, strength, conditions))
            for at, state in ((PLACE_I, state_i), (PLACE_J, members.pop("state_j", None))):
                numbers = asdict(state or fresh).items()
                upload([(getattr(effects.states[0], name), [value]) for name, value in numbers], at)
        place = bench.grain if advances else getattr(bench, effect.place)
        write_members(place, members)
        if not advances:
            return evaluate_on_bench(effect, effects, bench)
        assert effect.grain_state is not None
        advance_bench_state(bench.grain, effects)
        names = [f.name for f in fields(effect.grain_state)]
        after = download([getattr(effects.states[0], name) for name in names], PLACE_I, 1)
        return effect.grain_state(**{name: float(one[0]) for name, one in zip(names, after, strict=True)})

    return probe


def write_members(place: Any, members: Mapping[str, Any]) -> None:
    """Write the members of a struct field, 0 where one is not named."""
    zeros = {name: np.zeros(getattr(getattr(place, name), "n", 1)) for name in place.keys}
    upload([(getattr(place, name), [value]) for name, value in (zeros | dict(members)).items()])


def evaluate_on_bench(effect: Effect, effects: effect_device.DeviceEffects, bench: Bench) -> Any:
    """Result of an effect for the pair, first contact or grain of the bench."""
    if effect.place == "grain":
        evaluate_bench_grain(effects, bench.grain, bench.force, bench.torque)
        return tuple(download_field(answer)[0].astype(np.float64) for answer in (bench.force, bench.torque))
    if effect.place == "pair":
        evaluate_bench_pair(effects, bench.pair, bench.scalar, bench.force)
    else:
        evaluate_bench_contact(effects, bench.first_contact, bench.scalar)
    if effect.vector:
        return download_field(bench.force)[0].astype(np.float64)
    return float(download_field(bench.scalar)[0])


def falsify_parameter(probe: Probe, name: str, factor: float) -> Probe:
    """The same probe with one parameter made wrong by a factor."""

    def wrong_probe(params: Any, conditions: Conditions, **members: Any) -> Any:
        return probe(replace(params, **{name: factor * getattr(params, name)}), conditions, **members)

    return wrong_probe
