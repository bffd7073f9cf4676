"""Sleep: deep grains that have been at rest for a while are fixed, and contacts among them are skipped.

A grain falls asleep at an exchange with the air when it and every grain it touches have kept

    |v| < c sqrt(g d)    and    R |w| < c sqrt(g d)

for so many exchanges in a row, and the air and all other steady forces on it are below a small share of its
weight: such a grain lies too deep for the wind. It wakes when they exceed that share, or as soon as the force
F that awake grains exert on it has changed by more than the share s of its weight,

    |F - F_0| > s m g.

F_0 is recorded when it falls asleep, and again whenever a grain that it touches does so or wakes. A contact
force above s m g wakes it at once, and its motion then wakes its neighbours.

Sleeping grains keep their places and contact histories. The force between a sleeping and an awake grain acts
on both. The momentum that a sleeping grain receives goes to the ground, as from a grain that touches the
floor; its drag counts like that of any other.
"""

from typing import Any

from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record
from taichi_erosion.grains.frozen_drag import velocity_after_drag
from taichi_erosion.grains.neighbour_list import ENGAGED, entry_count
from taichi_erosion.grains.partition import owns_partition, wait_at_barrier
from taichi_erosion.grains.state import arrays, side_start

REST_SPEED = 1e-2  # c: in the time sqrt(d / g) such a grain moves by a hundredth of its diameter [1]
DEEP = 0.05  # of its weight, by air and fields: a grain with more lies open to the wind [1]

AWAKE = 0
WOKEN = 1  # awake from the next force evaluation on
FALLING_ASLEEP = 2  # asleep from the next force evaluation on; from here upwards a grain is fixed
RECORDING = 3  # asleep, and records anew the force of awake grains on it
ASLEEP = 4


@device_record
class Sleep:
    """Sleep state by grain place, both sides, as in `Grains`; the last two by replica."""

    state: Any  # i32, AWAKE to ASLEEP
    rest_count: Any  # i32, exchanges in a row at rest
    unsettled: Any  # i32, 1 where the grain or one that it touches is not at rest
    load: Any  # vec3, force of awake grains when last recorded [N]
    rest_least: Any  # i32, exchanges at rest before a grain falls asleep; 0: none ever does
    share: Any  # of the weight: change of load that wakes [1]


SAVED_FIELDS = ("state", "rest_count", "load")


def allocate_sleep(replicas: int, capacity: int) -> Sleep:
    """Fields for `capacity` places a replica and side."""
    # each by itself: the force loop reads the state alone
    table = arrays(2 * replicas * capacity, i32="state rest_count unsettled", realx3="load")
    return Sleep(**table, **arrays(replicas, i32="rest_least", real="share"))


@ti.func
def is_asleep(sleep: ti.template(), i):
    """Whether the grain at place i is fixed."""
    return sleep.state[i] >= FALLING_ASLEEP


@ti.func
def copy_sleep_state(sleep_out: ti.template(), k, i):
    """Copy the sleep state of place i to place k."""
    for field_out in ti.static((sleep_out.state, sleep_out.rest_count, sleep_out.load)):
        field_out[k] = field_out[i]


@ti.func
def set_awake(sleep_out: ti.template(), i):
    for field_out in ti.static((sleep_out.state, sleep_out.rest_count, sleep_out.load)):
        field_out[i] = 0 * field_out[i]


@ti.func
def record_sleep_change(sleep_out: ti.template(), i, j):
    """Set RECORDING for a sleeping grain of the pair whose partner has just woken or fallen asleep."""
    first, second = sleep_out.state[i], sleep_out.state[j]
    if first == ASLEEP and (second == WOKEN or second == FALLING_ASLEEP):
        sleep_out.state[i] = RECORDING
    if second == ASLEEP and (first == WOKEN or first == FALLING_ASLEEP):
        sleep_out.state[j] = RECORDING


@ti.func
def first_awake_entry(world_out: ti.template(), base, e, end):
    """First entry from e on with at least one awake grain."""
    awake = e
    if ti.static(world_out.sleeps):
        asleep = 1
        while awake < end and asleep == 1:
            i, j = base + world_out.pairs.owner[awake], base + world_out.pairs.neighbour[awake]
            asleep = ti.cast(is_asleep(world_out.sleep, i) and is_asleep(world_out.sleep, j), ti.i32)
            if asleep == 1:
                record_sleep_change(world_out.sleep, i, j)
                awake += 1
    return awake


@ti.func
def hold_sleeping_grain(world_out: ti.template(), r, i, buffer, kick):
    """Fix a sleeping grain at place i for one step, and clear its buffer; returns whether it sleeps."""
    grains_out, sleep_out = ti.static((world_out.grains, world_out.sleep))
    asleep = is_asleep(sleep_out, i)
    if asleep:
        force = grains_out.force[buffer]
        bearable = sleep_out.share[r] * world_out.replicas.gravity[r].norm() / grains_out.mass_inverse[i]
        if sleep_out.state[i] != ASLEEP:
            sleep_out.load[i] = force
            sleep_out.state[i] = ASLEEP
        elif not (force - sleep_out.load[i]).norm() <= bearable:  # also where it is not a number
            sleep_out.state[i] = WOKEN
            sleep_out.rest_count[i] = 0
        velocity_after_drag(world_out.frozen_drag, i, grains_out.velocity[i], kick)
        grains_out.force[buffer] = 0.0 * force
        grains_out.torque[buffer] = 0.0 * force
    elif sleep_out.state[i] == WOKEN:
        sleep_out.state[i] = AWAKE
    return asleep


@ti.func
def count_rest_exchanges(world_out: ti.template(), r, i):
    """Count the exchanges in a row at which the grain at place i was at rest."""
    grains, sleep_out = ti.static((world_out.grains, world_out.sleep))
    radius = grains.radius[i]
    fastest = REST_SPEED * ti.sqrt(2.0 * radius * world_out.replicas.gravity[r].norm())
    at_rest = grains.velocity[i].norm() < fastest and radius * grains.spin[i].norm() < fastest
    sleep_out.rest_count[i] = ti.select(at_rest, sleep_out.rest_count[i] + 1, 0)
    sleep_out.unsettled[i] = 0


@ti.func
def mark_unsettled_pairs(world_out: ti.template(), r, i):
    """Mark both grains of every engaged pair of the grain at place i where one has not rested long enough."""
    pairs, sleep_out = ti.static((world_out.pairs, world_out.sleep))
    base, rest_least = side_start(world_out.grains, r, world_out.replicas.side[r]), sleep_out.rest_least[r]
    for k in range(entry_count(pairs, i)):
        e = pairs.start[i] + k * pairs.stride
        j = base + pairs.neighbour[e]
        rested = ti.min(sleep_out.rest_count[i], sleep_out.rest_count[j])
        if pairs.label[e] & ENGAGED == ENGAGED and rested < rest_least:
            # any other worker that writes here writes the same
            sleep_out.unsettled[i] = 1
            sleep_out.unsettled[j] = 1


@ti.func
def update_sleep_state(world_out: ti.template(), r, i):
    """Put the grain at place i to sleep or wake it, by the steady forces on it."""
    grains_out, frozen, sleep_out = ti.static((world_out.grains, world_out.frozen_drag, world_out.sleep))
    drag = frozen.drag_rate[i] * (frozen.air_velocity[i] - grains_out.velocity[i])
    steady = drag + frozen.steady_acceleration[i]
    deep = steady.norm() < DEEP * world_out.replicas.gravity[r].norm()
    if is_asleep(sleep_out, i):
        if not deep:
            sleep_out.state[i] = WOKEN
            sleep_out.rest_count[i] = 0
    elif deep and sleep_out.rest_count[i] >= sleep_out.rest_least[r] and sleep_out.unsettled[i] == 0:
        sleep_out.state[i] = FALLING_ASLEEP
        grains_out.velocity[i] = 0.0 * grains_out.velocity[i]
        grains_out.spin[i] = 0.0 * grains_out.spin[i]


@ti.func
def update_sleep_states(world_out: ti.template(), r, member, size, phase):
    """Sleep states of replica r until the next exchange; returns the next barrier."""
    (replicas_out,) = ti.static((world_out.replicas,))
    if world_out.sleep.rest_least[r] > 0:
        base = side_start(world_out.grains, r, replicas_out.side[r])
        for task in ti.static((count_rest_exchanges, mark_unsettled_pairs, update_sleep_state)):
            for p in range(replicas_out.partitions[r]):
                if owns_partition(replicas_out, r, p, member, size):
                    for rank in range(replicas_out.bounds[r, p], replicas_out.bounds[r, p + 1]):
                        task(world_out, r, base + rank)
            phase = wait_at_barrier(replicas_out, r, size, phase)
    return phase
