"""Sleep: deep grains that have been at rest for a while are held, and contacts among them are left out.

A grain falls asleep at a look when it and every grain it touches have kept

    |v| < c sqrt(g d)    and    R |w| < c sqrt(g d)

for so many looks in a row, and the air and all other held forces push it by less than a small share of its
weight: deep is what the wind hardly reaches. It wakes when they push harder, or as soon as the force F that
awake grains put on it has changed by more than the share s of its weight,

    |F - F_0| > s m g.

F_0 is noted when it falls asleep, and anew whenever a grain that it touches does so or wakes. A touch harder
than s m g wakes it at once, and what it then does to its neighbours wakes them.

Sleepers stay where they are and keep the memory of their contacts: a grain that wakes finds them as it left
them. The force between a sleeper and an awake grain acts on both. What a sleeper gets goes to the ground that
holds it, as from a grain that touches the floor; its drag is booked like that of any other.
"""

from dataclasses import dataclass
from typing import Any

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.frozen_drag import apply_drag
from taichi_erosion.grains.neighbour_list import ENGAGED
from taichi_erosion.grains.partition import barrier, owns_partition
from taichi_erosion.grains.state import partition_first, side_block, vector

CALM = 1e-2  # c: in the time sqrt(d / g) such a grain moves by a hundredth of its diameter [1]
DEEP = 0.05  # of its weight, by the surroundings: a grain that feels more lies open to the wind [1]

AWAKE = 0
WOKEN = 1  # awake from the next forces on
FALLING = 2  # asleep from the next forces on; from here upwards a grain is held
NOTING = 3  # asleep, and notes anew what awake grains put on it
ASLEEP = 4


@dataclass(frozen=True, eq=False)
class Sleep:
    """Who sleeps: by grain place, both sides, as in `Grains`; the last two by replica."""

    state: Any  # i32, AWAKE to ASLEEP
    calm: Any  # i32, looks in a row at rest
    restless: Any  # i32, 1 where a grain that it touches is not at rest
    load: Any  # vec3, force of the awake when that was noted last [N]
    looks: Any  # i32, at rest before a grain falls asleep; 0: none ever does
    share: Any  # of the weight, that disturbs [1]


SAVED_FIELDS = ("state", "calm", "load")


def allocate_sleep(replicas: int, capacity: int) -> Sleep:
    """Fields for `capacity` places a replica and side."""
    labels = {name: ti.field(ti.i32) for name in ("state", "calm", "restless")}
    table: dict[str, Any] = labels | {"load": vector()}
    # the force loop asks who sleeps, and nothing else
    for name in table:
        ti.root.dense(ti.i, 2 * replicas * capacity).place(table[name])
    return Sleep(**table, looks=ti.field(ti.i32, shape=replicas), share=ti.field(float, shape=replicas))


@ti.func
def is_asleep(sleep: ti.template(), i):
    """Whether the grain at place i is held."""
    return sleep.state[i] >= FALLING


@ti.func
def move_sleep(sleep_out: ti.template(), k, i):
    """Carry the sleep of place i to place k."""
    for field_out in ti.static((sleep_out.state, sleep_out.calm, sleep_out.load)):
        field_out[k] = field_out[i]


@ti.func
def clear_sleep(sleep_out: ti.template(), i):
    """A grain that begins is awake."""
    for field_out in ti.static((sleep_out.state, sleep_out.calm, sleep_out.load)):
        field_out[i] = 0 * field_out[i]


@ti.func
def note_wake(sleep_out: ti.template(), i, j):
    """A sleeper notes its load anew where a grain that it touches has just woken or fallen asleep."""
    first, second = sleep_out.state[i], sleep_out.state[j]
    if first == ASLEEP and (second == WOKEN or second == FALLING):
        sleep_out.state[i] = NOTING
    if second == ASLEEP and (first == WOKEN or first == FALLING):
        sleep_out.state[j] = NOTING


@ti.func
def next_awake(world_out: ti.template(), base, e, end):
    """First entry from e on of which not both grains sleep."""
    found = e
    if ti.static(world_out.sleeps):
        asleep = 1
        while found < end and asleep == 1:
            i, j = base + world_out.pairs.owner[found], base + world_out.pairs.neighbour[found]
            asleep = ti.cast(is_asleep(world_out.sleep, i) and is_asleep(world_out.sleep, j), ti.i32)
            if asleep == 1:
                note_wake(world_out.sleep, i, j)
                found += 1
    return found


@ti.func
def hold_sleeping(world_out: ti.template(), r, i, buffer, kick):
    """Hold the grain at place i for one step where it sleeps, and clear its buffer; says whether it does."""
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
            sleep_out.calm[i] = 0
        apply_drag(world_out.frozen_drag, i, grains_out.velocity[i], kick)
        grains_out.force[buffer] = 0.0 * force
        grains_out.torque[buffer] = 0.0 * force
    elif sleep_out.state[i] == WOKEN:
        sleep_out.state[i] = AWAKE
    return asleep


@ti.func
def count_rest(world_out: ti.template(), r, i):
    """Count the looks at which the grain at place i was at rest."""
    grains, sleep_out = ti.static((world_out.grains, world_out.sleep))
    radius = grains.radius[i]
    fastest = CALM * ti.sqrt(2.0 * radius * world_out.replicas.gravity[r].norm())
    at_rest = grains.velocity[i].norm() < fastest and radius * grains.spin[i].norm() < fastest
    sleep_out.calm[i] = ti.select(at_rest, sleep_out.calm[i] + 1, 0)
    sleep_out.restless[i] = 0


@ti.func
def mark_unsettled(world_out: ti.template(), r, i):
    """Tell whom the grain at place i touches, of the pairs it owns, that one of the two is not at rest."""
    pairs, sleep_out = ti.static((world_out.pairs, world_out.sleep))
    base, looks = side_block(world_out.grains, r, world_out.replicas.side[r]), sleep_out.looks[r]
    for e in range(pairs.start[i], pairs.stop[i]):
        j = base + pairs.neighbour[e]
        if pairs.label[e] & ENGAGED == ENGAGED and ti.min(sleep_out.calm[i], sleep_out.calm[j]) < looks:
            # whoever else writes here writes the same
            sleep_out.restless[i] = 1
            sleep_out.restless[j] = 1


@ti.func
def update_sleep_state(world_out: ti.template(), r, i):
    """Let the grain at place i fall asleep, or wake, by what it feels of its surroundings."""
    grains_out, frozen, sleep_out = ti.static((world_out.grains, world_out.frozen_drag, world_out.sleep))
    feels = (
        frozen.drag_rate[i] * (frozen.air_velocity[i] - grains_out.velocity[i])
        + frozen.steady_acceleration[i]
    )
    deep = feels.norm() < DEEP * world_out.replicas.gravity[r].norm()
    if is_asleep(sleep_out, i):
        if not deep:
            sleep_out.state[i] = WOKEN
            sleep_out.calm[i] = 0
    elif deep and sleep_out.calm[i] >= sleep_out.looks[r] and sleep_out.restless[i] == 0:
        sleep_out.state[i] = FALLING
        grains_out.velocity[i] = 0.0 * grains_out.velocity[i]
        grains_out.spin[i] = 0.0 * grains_out.spin[i]


@ti.func
def update_sleep(world_out: ti.template(), r, member, size, turn):
    """Who of replica r sleeps until the next look; returns the next meeting of the team."""
    (replicas_out,) = ti.static((world_out.replicas,))
    if world_out.sleep.looks[r] > 0:
        base = side_block(world_out.grains, r, replicas_out.side[r])
        for task in ti.static((count_rest, mark_unsettled, update_sleep_state)):
            for p in range(replicas_out.partitions[r]):
                if owns_partition(replicas_out, r, p, member, size):
                    first = partition_first(replicas_out, r, p)
                    for rank in range(first, partition_first(replicas_out, r, p + 1)):
                        task(world_out, r, base + rank)
            turn = barrier(replicas_out, r, size, turn)
    return turn
