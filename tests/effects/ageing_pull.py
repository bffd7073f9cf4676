"""Ageing pull: grains that touch attract each other the harder, the longer both have lain still.

    F = F0 min(t / T, 1)    s <= 0
    F = 0                   s > 0

with F0 the pull-off force of an old contact [N], s the gap [m], t the time that the grain which moved last
has been slower than v_0 [s], and T the time in which a contact grows old [s]. A wall is as old as can be.
Strength multiplies F0. Holds for stiff grains and exchange intervals well below T.

Reference: Castellanos (2005), Adv. Phys. 54, 263 (pull-off forces of powders, and how they grow in time).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe, quantity
from taichi_erosion.core.ti import ti


@dataclass(frozen=True)
class Params:
    pull_off: float = quantity(1e-7, "N", "force that parts two old grains", low=0.0, high=1e-3)
    ageing: float = quantity(0.1, "s", "time in which a contact grows old", low=1e-6, high=1e6)
    still: float = quantity(1e-3, "m s-1", "speed below which a grain grows old", low=1e-6, high=1.0)


@dataclass(frozen=True)
class State:
    """State variables of every grain; each begins with its default."""

    age: float = quantity(0.0, "s", "time that it has lain still")


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica, worked out once on the host; the device reads them by name."""
    return {"pull": strength * params.pull_off, "ageing": params.ageing, "still": params.still}


@ti.func
def update_state(constants, grain, state):
    """State after one exchange interval; the members of `grain` stand in core/effect.py."""
    after = state
    after.age = ti.select(grain.velocity.norm() < constants.still, state.age + grain.interval, 0.0)
    return after


@ti.func
def pull(constants, pair, state_i, state_j):
    """Attraction [N]; `state_i` and `state_j` are the states of grains i and j, zeros for a wall."""
    youngest = ti.select(pair.radius_j > 0.0, ti.min(state_i.age, state_j.age), state_i.age)
    share = ti.min(youngest / constants.ageing, 1.0)
    return ti.select(pair.gap <= 0.0, share * constants.pull, 0.0)


def checks(probe: Probe) -> Iterator[Check]:
    """At least three statements; a parameter that is wrong by 10 % must break one of them."""
    glue = Params(pull_off=2e-6, ageing=0.2, still=1e-3)
    young, old = State(age=0.05), State(age=0.3)

    def force(gap: float, state_i: State, radius_j: float = 1e-4) -> float:
        return probe(glue, {}, gap=gap, radius_i=1e-4, radius_j=radius_j, state_i=state_i, state_j=old)

    def age(before: State | None, speed: float) -> float:
        return probe(glue, {}, state_before=before, velocity=(speed, 0.0, 0.0), interval=0.01).age

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
    grain_state=State,
    update_state=update_state,
)
