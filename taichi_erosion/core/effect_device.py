"""Effects on the device: their functions, the constants of every replica, and state variables of grains.

States lie by grain place, both sides, like every other property of a grain. They change at exchanges with the
air only, each grain's by the worker of its partition, so nothing in them depends on the number of workers.
Without states nothing of this is compiled in.
"""

from collections.abc import Sequence
from typing import Any

from taichi_erosion.core.effect import Constants, ReplicaEffect
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record, download_field, upload, write_field


@device_record
class DeviceEffects:
    """Device functions of the effects of one place of a run; each reads the constants of its replica."""

    functions: tuple[Any, ...]  # ti.func of each effect
    constants: tuple[Any, ...]  # struct field by replica
    names: tuple[str, ...]  # in the same order
    present: Any  # i32 [replica, effect]: 0 where the replica is without it
    any: bool  # compiled in: whether there is any effect
    vector: tuple[bool, ...]  # whether each gives a vector, compiled in
    any_vector: bool
    drags: tuple[Any, ...]  # ti.func of each that has a factor of the drag, else None
    any_drag: bool  # compiled in: whether any changes the drag
    gusts: tuple[Any, ...]  # ti.func of each that has gusts, else None
    any_gust: bool  # compiled in: whether any has gusts
    states: tuple[Any, ...]  # struct field by grain place, then the zeros of a wall; None without variables
    initial_states: tuple[Any, ...]  # struct field by replica
    updates: tuple[Any, ...]  # ti.func of each that has state variables, else None
    wall_place: int  # place whose state is zero: a wall in the role of grain j
    has_state: bool  # whether any has state variables, compiled in


def bind(place: str, replicas: Sequence[Sequence[ReplicaEffect]], grain_places: int = 0) -> DeviceEffects:
    """Effects of one place on the device; a replica may lack an effect that another has.

    They act in the order of their names, so that their sum has the same bits beside any other replicas.
    """
    effects_by_name = {one.effect.name: one for row in replicas for one in row if one.effect.place == place}
    examples = [effects_by_name[name] for name in sorted(effects_by_name)]
    effects = [one.effect for one in examples]
    count = len(replicas)
    bound = DeviceEffects(
        functions=tuple(effect.act for effect in effects),
        constants=tuple(allocate_struct_field(list(one.constants), count) for one in examples),
        names=tuple(effect.name for effect in effects),
        present=ti.field(ti.i32, shape=(count, max(len(effects), 1))),
        any=bool(effects),
        vector=tuple(effect.vector for effect in effects),
        any_vector=any(effect.vector for effect in effects),
        drags=tuple(effect.drag for effect in effects),
        any_drag=any(effect.drag is not None for effect in effects),
        gusts=tuple(effect.gust for effect in effects),
        any_gust=any(effect.gust is not None for effect in effects),
        states=tuple(allocate_struct_field(list(one.initial_state), grain_places + 1) for one in examples),
        initial_states=tuple(allocate_struct_field(list(one.initial_state), count) for one in examples),
        updates=tuple(effect.update_state for effect in effects),
        wall_place=grain_places,
        has_state=any(effect.update_state is not None for effect in effects),
    )
    write_effect_constants(bound, replicas)
    return bound


def write_effect_constants(
    effects: DeviceEffects, replicas: Sequence[Sequence[ReplicaEffect]], first: int = 0
) -> None:
    """Write presence and constants of effects for the replicas from the first on; states of grains stay.

    All effects of the replicas must be included.
    """
    present = download_field(effects.present)
    for k, name in enumerate(effects.names):
        rows = [next((one for one in row if one.effect.name == name), None) for row in replicas]
        present[first : first + len(rows), k] = [one is not None for one in rows]
        write_table(effects.constants[k], [one.constants if one else {} for one in rows], first)
        write_table(effects.initial_states[k], [one.initial_state if one else {} for one in rows], first)
    write_field(effects.present, present)


def allocate_struct_field(names: Sequence[str], places: int) -> Any:
    """Field of one struct of reals a place; None without names."""
    return ti.types.struct(**dict.fromkeys(names, float)).field(shape=places) if names else None


def write_table(table: Any, rows: Sequence[Constants], first: int) -> None:
    """Write the numbers of replicas from the first on, 0 where one has none; nothing without a table."""
    if table is not None:
        upload([(getattr(table, name), [row.get(name, 0.0) for row in rows]) for name in table.keys], first)


def effect_state_fields(effects: DeviceEffects) -> dict[str, tuple[Any, Any]]:
    """By `effect.variable`: field of a state variable by grain place, and of its initial value by replica."""
    return {
        f"{name}.{variable}": (getattr(state, variable), getattr(start, variable))
        for name, state, start in zip(effects.names, effects.states, effects.initial_states, strict=True)
        if state is not None
        for variable in state.keys
    }


@ti.func
def evaluate_pair_effect(effects: ti.template(), k: ti.template(), r, pair: ti.template(), i, j):
    """Attraction, or force vector on place i, of effect k between places i and j [N]."""
    if ti.static(effects.updates[k]):
        return effects.functions[k](effects.constants[k][r], pair, effects.states[k][i], effects.states[k][j])
    else:
        return effects.functions[k](effects.constants[k][r], pair)


@ti.func
def total_attraction(effects: ti.template(), r, pair: ti.template(), i, j):
    """Sum of the attractions of all scalar pair effects of replica r between places i and j [N]."""
    total = 0.0
    for k in ti.static(range(len(effects.functions))):
        if ti.static(not effects.vector[k]):
            if effects.present[r, k] == 1:
                total += evaluate_pair_effect(effects, k, r, pair, i, j)
    return total


@ti.func
def total_vector_force(effects: ti.template(), r, pair: ti.template(), i, j):
    """Sum of the forces on place i of all vector pair effects of replica r [N]."""
    total = 0.0 * pair.normal
    for k in ti.static(range(len(effects.functions))):
        if ti.static(effects.vector[k]):
            if effects.present[r, k] == 1:
                total += evaluate_pair_effect(effects, k, r, pair, i, j).xyz  # a number has no xyz
    return total


@ti.func
def any_lets_pass(effects: ti.template(), r, contact: ti.template()):
    """Whether any first-contact effect of replica r lets the two grains pass through each other."""
    free = 0
    for k in ti.static(range(len(effects.functions))):
        if effects.present[r, k] == 1:
            free = ti.max(free, ti.cast(effects.functions[k](effects.constants[k][r], contact), ti.i32))
    return free


@ti.func
def evaluate_grain_effect(effects: ti.template(), k: ti.template(), r, grain: ti.template(), i):
    """Force [N] and torque [N m] of effect k on place i."""
    if ti.static(effects.updates[k]):
        return effects.functions[k](effects.constants[k][r], grain, effects.states[k][i])
    else:
        return effects.functions[k](effects.constants[k][r], grain)


@ti.func
def total_drag_factor(effects: ti.template(), r, grain: ti.template()):
    """Product of the drag factors of all grain effects of replica r [1]."""
    factor = 1.0
    for k in ti.static(range(len(effects.functions))):
        if ti.static(effects.drags[k]):
            if effects.present[r, k] == 1:
                factor *= effects.drags[k](effects.constants[k][r], grain)
    return factor


@ti.func
def total_gust(effects: ti.template(), r, grain: ti.template()):
    """Sum of the gusts of all grain effects of replica r [m s-1]."""
    gust = 0.0 * grain.velocity
    for k in ti.static(range(len(effects.functions))):
        if ti.static(effects.gusts[k]):
            if effects.present[r, k] == 1:
                gust += effects.gusts[k](effects.constants[k][r], grain)
    return gust


@ti.func
def add_gusts(effects: ti.template(), r, grain_out: ti.template()):
    """Drag that gusts add to that of the mean wind [N]; the grain then has wind and shear of the gust.

    The shear grows as the streamwise wind, as where the profile of the mean wind is scaled. Writes
    grain_out.air_velocity, grain_out.air_shear, grain_out.drag_factor.
    """
    gust = total_gust(effects, r, grain_out)
    mean = grain_out.air_velocity
    before = grain_out.drag(mean - grain_out.velocity)
    grain_out.air_velocity = mean + gust
    if mean[0] != 0.0:
        grain_out.air_shear *= 1.0 + gust[0] / mean[0]
    grain_out.drag_factor = total_drag_factor(effects, r, grain_out)
    return grain_out.drag(grain_out.air_velocity - grain_out.velocity) - before


@ti.func
def total_grain_force(effects: ti.template(), r, grain: ti.template(), i):
    """Sum of the forces [N] and torques [N m] of all grain effects of replica r on place i."""
    force = 0.0 * grain.velocity
    torque = force
    for k in ti.static(range(len(effects.functions))):
        if effects.present[r, k] == 1:
            part, moment = evaluate_grain_effect(effects, k, r, grain, i)
            force += part.xyz  # a number has no xyz: it would count along all three axes
            torque += moment.xyz
    return force, torque


@ti.func
def advance_states(effects_out: ti.template(), r, grain: ti.template(), i):
    """Advance the state variables of the grain at place i by one exchange interval.

    Writes effects_out.states.
    """
    for k in ti.static(range(len(effects_out.functions))):
        if ti.static(effects_out.updates[k]):
            if effects_out.present[r, k] == 1:
                before = effects_out.states[k][i]
                effects_out.states[k][i] = effects_out.updates[k](effects_out.constants[k][r], grain, before)


@ti.func
def copy_effect_states(effects_out: ti.template(), k, i):
    """Copy the state variables of place i to place k."""
    for n in ti.static(range(len(effects_out.functions))):
        if ti.static(effects_out.updates[n]):
            effects_out.states[n][k] = effects_out.states[n][i]


@ti.func
def set_initial_effect_states(effects_out: ti.template(), r, i):
    """State variables of a grain that enters at place i."""
    for k in ti.static(range(len(effects_out.functions))):
        if ti.static(effects_out.updates[k]):
            effects_out.states[k][i] = effects_out.initial_states[k][r]
