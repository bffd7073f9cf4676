"""Effects on the device: their functions, the constants of every replica, and what they remember of grains.

A memory lies by grain place, both sides, as everything else that a grain carries. It changes at looks only,
and each grain's by the worker of its partition alone, so nothing in it depends on how many workers there are.
Without a memory nothing of all this is compiled in.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from taichi_erosion.core.effect import Acting, Effect
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import read, upload, write


@dataclass(frozen=True, eq=False)
class Bound:
    """Device functions of the effects of one place of a run; each reads the constants of its replica."""

    acts: tuple[Any, ...]  # ti.func of each effect
    constants: tuple[Any, ...]  # struct field by replica
    names: tuple[str, ...]  # in the same order
    present: Any  # i32 [replica, effect]: 0 where the replica is without it
    any: bool  # compiled in: with none, nothing of them is in the kernels
    whole: tuple[bool, ...]  # whether each gives a vector, compiled in
    thrusts: bool  # whether any does
    keeps: tuple[bool, ...]  # whether each remembers something, compiled in
    memories: tuple[Any, ...]  # struct field by grain place, its last place nobody's; one number where none
    starts: tuple[Any, ...]  # struct field by replica, of grains that enter
    updates: tuple[Any, ...]  # ti.func of each that remembers
    nobody: int  # place whose memory is zeros: what stands for a wall
    remembers: bool  # whether any remembers something, compiled in

    def holds(self, effect: Effect) -> bool:
        """Whether an effect is compiled into the run."""
        return effect.name in self.names


def bind(place: str, replicas: Sequence[Sequence[Acting]], grain_places: int = 0) -> Bound:
    """Put the effects of one place on the device; a replica may lack an effect that another has.

    They act in the order of their names, so that their sum has the same bits beside any other replicas.
    """
    known = {a.effect.name: a.effect for row in replicas for a in row if a.effect.place == place}
    effects = [known[name] for name in sorted(known)]
    count = len(replicas)
    examples = [next(a for row in replicas for a in row if a.effect.name == e.name) for e in effects]
    keeps = tuple(effect.memory is not None for effect in effects)
    bound = Bound(
        acts=tuple(e.act for e in effects),
        constants=tuple(struct_field(list(a.constants), count) for a in examples),
        names=tuple(effect.name for effect in effects),
        present=ti.field(ti.i32, shape=(count, max(len(effects), 1))),
        any=bool(effects),
        whole=tuple(effect.whole for effect in effects),
        thrusts=any(effect.whole for effect in effects),
        keeps=keeps,
        memories=tuple(struct_field(memory_names(e), grain_places + 1) for e in effects),
        starts=tuple(struct_field(list(a.start), count) for a in examples),
        updates=tuple(e.remember for e in effects),
        nobody=grain_places,
        remembers=any(keeps),
    )
    write_constants(bound, replicas)
    return bound


def memory_names(effect: Effect) -> list[str]:
    """Numbers that an effect remembers of every grain."""
    return [] if effect.memory is None else [f.name for f in fields(effect.memory)]


def write_constants(bound: Bound, replicas: Sequence[Sequence[Acting]]) -> None:
    """Say which replica has which effect, with which constants; all effects of the place must be held."""
    held = np.zeros((len(replicas), max(len(bound.names), 1)), np.int32)
    for k, name in enumerate(bound.names):
        rows = [next((a for a in acts if a.effect.name == name), None) for acts in replicas]
        held[:, k] = [row is not None for row in rows]
        write_table(bound.constants[k], [None if row is None else row.constants for row in rows])
        write_table(bound.starts[k], [None if row is None else row.start for row in rows])
    write(bound.present, held)


def struct_field(names: Sequence[str], places: int) -> Any:
    """Field of one struct of reals a place; None without names."""
    return ti.types.struct(**dict.fromkeys(names, float)).field(shape=places) if names else None


def write_table(table: Any, rows: Sequence[dict[str, float] | None], first: int = 0) -> None:
    """Write the numbers of replicas from the first on, 0 where one has none; nothing without a table."""
    if table is not None:
        columns = {name: [0.0 if row is None else row[name] for row in rows] for name in table.keys}
        upload([(getattr(table, name), column) for name, column in columns.items()], first)


def rebind(bound: Bound, replica: int, effects: Sequence[Acting]) -> None:
    """Give one replica other constants; all its effects must be held. What they remember stays."""
    given = {one.effect.name: one for one in effects}
    held = read(bound.present)
    for k, name in enumerate(bound.names):
        held[replica, k] = name in given
        if name in given:
            write_table(bound.constants[k], [given[name].constants], replica)
            write_table(bound.starts[k], [given[name].start], replica)
    write(bound.present, held)


def memory_fields(bound: Bound) -> dict[str, tuple[Any, Any]]:
    """By `effect.number`: field of a remembered number by grain place, and of its start by replica."""
    return {
        f"{name}.{number}": (getattr(memory, number), getattr(start, number))
        for name, keeps, memory, start in zip(
            bound.names, bound.keeps, bound.memories, bound.starts, strict=True
        )
        if keeps
        for number in memory.keys
    }


@ti.func
def one_pull(bound: ti.template(), k: ti.template(), r, pair: ti.template(), i, j):
    """What effect k gives between places i and j: an attraction, or a force on place i [N]."""
    if ti.static(bound.keeps[k]):
        return bound.acts[k](bound.constants[k][r], pair, bound.memories[k][i], bound.memories[k][j])
    else:
        return bound.acts[k](bound.constants[k][r], pair)


@ti.func
def pull_of(bound: ti.template(), r, pair: ti.template(), i, j):
    """Sum of the attractions of all pair effects of replica r between places i and j [N]."""
    total = 0.0
    for k in ti.static(range(len(bound.acts))):
        if ti.static(not bound.whole[k]):
            if bound.present[r, k] == 1:
                total += one_pull(bound, k, r, pair, i, j)
    return total


@ti.func
def force_of(bound: ti.template(), r, pair: ti.template(), i, j):
    """Sum of the forces on place i of all pair effects of replica r that are whole [N]."""
    total = 0.0 * pair.normal
    for k in ti.static(range(len(bound.acts))):
        if ti.static(bound.whole[k]):
            if bound.present[r, k] == 1:
                total += one_pull(bound, k, r, pair, i, j)
    return total


@ti.func
def passes(bound: ti.template(), r, meeting: ti.template()):
    """Whether any meeting effect of replica r lets the two grains pass through each other."""
    free = 0
    for k in ti.static(range(len(bound.acts))):
        if bound.present[r, k] == 1:
            free = ti.max(free, ti.cast(bound.acts[k](bound.constants[k][r], meeting), ti.i32))
    return free


@ti.func
def one_push(bound: ti.template(), k: ti.template(), r, grain: ti.template(), i):
    """Force [N] and torque [N m] that effect k gives to place i."""
    if ti.static(bound.keeps[k]):
        return bound.acts[k](bound.constants[k][r], grain, bound.memories[k][i])
    else:
        return bound.acts[k](bound.constants[k][r], grain)


@ti.func
def push_of(bound: ti.template(), r, grain: ti.template(), i):
    """Sum of the forces [N] and torques [N m] of all grain effects of replica r on place i."""
    force = 0.0 * grain.velocity
    torque = force
    for k in ti.static(range(len(bound.acts))):
        if bound.present[r, k] == 1:
            part, moment = one_push(bound, k, r, grain, i)
            force += part
            torque += moment
    return force, torque


@ti.func
def update_memory(bound_out: ti.template(), r, grain: ti.template(), i):
    """Let the effects of replica r remember a look at the grain at place i."""
    for k in ti.static(range(len(bound_out.acts))):
        if ti.static(bound_out.keeps[k]):
            if bound_out.present[r, k] == 1:
                before = bound_out.memories[k][i]
                bound_out.memories[k][i] = bound_out.updates[k](bound_out.constants[k][r], grain, before)


@ti.func
def move_memory(bound_out: ti.template(), k, i):
    """Carry what is remembered of place i to place k."""
    for n in ti.static(range(len(bound_out.acts))):
        if ti.static(bound_out.keeps[n]):
            bound_out.memories[n][k] = bound_out.memories[n][i]


@ti.func
def begin_memory(bound_out: ti.template(), r, i):
    """What is remembered of a grain that enters at place i."""
    for k in ti.static(range(len(bound_out.acts))):
        if ti.static(bound_out.keeps[k]):
            bound_out.memories[k][i] = bound_out.starts[k][r]
