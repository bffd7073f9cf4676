"""Frozen drag: the forces of air and fields on grains, held constant between two exchanges with the air.

The air is sampled once in many time steps of the grains. In between its drag is a rate b [s-1] towards a
velocity u, and all other forces are an acceleration f:

    v(t + dt/2) = (v' + b dt u) / (1 + b dt),    v' = v(t - dt/2) + (a + f) dt,

which is stable however large the rate is. The momentum that drag gives to a grain is summed up exactly: the
air loses just that.
"""

from typing import Any

from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_fields, device_record
from taichi_erosion.grains.state import block


@device_record
class FrozenDrag:
    """Frozen terms by grain place, both sides, as in `Grains`."""

    air_velocity: Any  # vec3, velocity that drag relaxes to [m s-1]
    drag_rate: Any  # rate of that relaxation [s-1]
    steady_acceleration: Any  # vec3, by everything that is not drag [m s-2]
    steady_spin_rate: Any  # vec3, likewise of the spin [rad s-2]
    drag_kick: Any  # vec3, change of velocity by drag since the last exchange [m s-1]


def allocate_frozen_drag(replicas: int, capacity: int) -> FrozenDrag:
    """Fields for `capacity` places a replica and side."""
    vectors = "air_velocity steady_acceleration steady_spin_rate drag_kick"
    return FrozenDrag(**block(2 * replicas * capacity, realx3=vectors, real="drag_rate"))


@ti.func
def velocity_after_drag(frozen_out: ti.template(), i, velocity, kick):
    """Velocity of the grain at place i after drag has acted for `kick` [s]."""
    share = frozen_out.drag_rate[i] * kick
    after = (velocity + share * frozen_out.air_velocity[i]) / (1.0 + share)
    frozen_out.drag_kick[i] = frozen_out.drag_kick[i] + (after - velocity)
    return after


@ti.func
def copy_frozen_drag(frozen_out: ti.template(), k, i):
    """Copy the frozen terms of place i to place k."""
    for field_out in ti.static(tuple(device_fields(frozen_out))):
        field_out[k] = field_out[i]


@ti.func
def clear_frozen_drag(frozen_out: ti.template(), i):
    """No frozen force on the grain at place i until the next exchange."""
    for field_out in ti.static(tuple(device_fields(frozen_out))):
        field_out[i] = 0.0 * field_out[i]
