"""Ageing pull: grains that touch attract each other the harder, the longer both have lain still.

    F = F0 min(t / T, 1)    s <= 0
    F = 0                   s > 0

with F0 the pull-off force of an old contact [N], s the gap [m], t the time that the grain which moved last
has been slower than v_0 [s], and T the time in which a contact grows old [s]. A wall is as old as can be.
Strength multiplies F0. Holds for stiff grains and looks that come often within T.

Reference: Castellanos (2005), Adv. Phys. 54, 263 (pull-off forces of powders, and how they grow in time).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe
from taichi_erosion.core.quantity import quantity
from taichi_erosion.core.ti import ti


@dataclass(frozen=True)
class Params:
    pull_off: float = quantity(1e-7, "N", "force that parts two old grains", low=0.0, high=1e-3)
    ageing: float = quantity(0.1, "s", "time in which a contact grows old", low=1e-6, high=1e6)
    still: float = quantity(1e-3, "m s-1", "speed below which a grain grows old", low=1e-6, high=1.0)


@dataclass(frozen=True)
class Memory:
    """What is remembered of every grain; each number begins as its default says."""

    age: float = quantity(0.0, "s", "time that it has lain still")


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica, worked out once on the host; the device reads them by name."""
    return {"pull": strength * params.pull_off, "ageing": params.ageing, "still": params.still}


@ti.func
def remember(constants, grain, memory):
    """Memory after a look at one grain; the members of `grain` stand in core/effect.py."""
    after = memory
    after.age = ti.select(grain.velocity.norm() < constants.still, memory.age + grain.interval, 0.0)
    return after


@ti.func
def pull(constants, pair, mine, other):
    """Attraction [N]; `mine` and `other` are what is remembered of grain i and j, zeros for a wall."""
    youngest = ti.select(pair.radius_j > 0.0, ti.min(mine.age, other.age), mine.age)
    share = ti.min(youngest / constants.ageing, 1.0)
    return ti.select(pair.gap <= 0.0, share * constants.pull, 0.0)


def checks(probe: Probe) -> Iterator[Check]:
    """At least three statements; a parameter that is wrong by 10 % must break one of them."""
    glue = Params(pull_off=2e-6, ageing=0.2, still=1e-3)
    young, old = Memory(age=0.05), Memory(age=0.3)

    def force(gap: float, mine: Memory, radius_j: float = 1e-4) -> float:
        return probe(glue, {}, gap=gap, radius_i=1e-4, radius_j=radius_j, mine=mine, other=old)

    def age(before: Memory | None, speed: float) -> float:
        return probe(glue, {}, before=before, velocity=(speed, 0.0, 0.0), interval=0.01).age

    yield Check("old grains attract each other with F0", force(0.0, old), 2e-6)
    yield Check("the younger of two counts", force(0.0, young), 0.5e-6)
    yield Check("at a wall the grain counts", force(0.0, young, radius_j=0.0), 0.5e-6)
    yield Check("grains apart feel nothing", force(1e-9, old), 0.0)
    yield Check("a grain that enters has no age", age(None, 0.0), 0.01)
    yield Check("at rest it grows older", age(young, 0.95e-3), 0.06)
    yield Check("a stir makes it young", age(old, 1.05e-3), 0.0)


EFFECT = Effect(
    name="ageing_pull",
    title="pull between grains that have lain still",
    doc=__doc__,
    place="pair",
    params=Params,
    act=pull,
    checks=checks,
    constants=constants,
    memory=Memory,
    remember=remember,
)
