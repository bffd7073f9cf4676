"""What the surroundings do to grains between two looks at them: drag towards a velocity, and steady pushes.

The air is looked at once in many time steps of the grains. In between its drag is held as a rate b [s-1]
towards a velocity u, and all other forces as an acceleration f:

    v(t + dt/2) = (v' + b dt u) / (1 + b dt),    v' = v(t - dt/2) + (a + f) dt,

which is stable however fast the drag is. The momentum that drag gives to a grain is summed up exactly, so
that the air can be made to lose it.
"""

from dataclasses import dataclass
from typing import Any

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.state import vector


@dataclass(frozen=True, eq=False)
class Held:
    """Held terms by grain place, both sides, as in `Grains`."""

    drift: Any  # vec3, velocity that drag pulls towards [m s-1]
    drift_rate: Any  # rate at which it does [s-1]
    push: Any  # vec3, acceleration by everything that is not drag [m s-2]
    twist: Any  # vec3, likewise of the spin [rad s-2]
    dragged: Any  # vec3, change of velocity by drag since the last look [m s-1]


HELD = ("drift", "drift_rate", "push", "twist", "dragged")


def allocate_held(replicas: int, capacity: int) -> Held:
    """Fields for `capacity` places a replica and side."""
    table = {name: vector() for name in HELD if name != "drift_rate"} | {"drift_rate": ti.field(float)}
    ti.root.dense(ti.i, 2 * replicas * capacity).place(*table.values())
    return Held(**table)


@ti.func
def drag_along(held_out: ti.template(), i, velocity, kick):
    """Velocity of the grain at place i after drag has acted for `kick` [s]."""
    share = held_out.drift_rate[i] * kick
    after = (velocity + share * held_out.drift[i]) / (1.0 + share)
    held_out.dragged[i] = held_out.dragged[i] + (after - velocity)
    return after


@ti.func
def move_held(held_out: ti.template(), k, i):
    """Carry the held terms of place i to place k."""
    for field_out in ti.static(
        (held_out.drift, held_out.drift_rate, held_out.push, held_out.twist, held_out.dragged)
    ):
        field_out[k] = field_out[i]


@ti.func
def clear_held(held_out: ti.template(), i):
    """Nothing acts on the grain at place i until the next look at it."""
    for field_out in ti.static(
        (held_out.drift, held_out.drift_rate, held_out.push, held_out.twist, held_out.dragged)
    ):
        field_out[i] = 0.0 * field_out[i]
