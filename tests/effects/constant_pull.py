"""Constant pull: grains that touch attract each other with a constant force.

    F = F0    s <= 0
    F = 0     s > 0

with F0 the pull-off force [N] and s the gap [m]. Strength multiplies F0. Holds for stiff grains.

Reference: Castellanos (2005), Adv. Phys. 54, 263 (pull-off forces of powders).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe, quantity
from taichi_erosion.core.ti import ti


@dataclass(frozen=True)
class Params:
    pull_off: float = quantity(1e-7, "N", "force that parts two touching grains", low=0.0, high=1e-3)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica, worked out once on the host; the device reads them by name."""
    return {"pull": strength * params.pull_off}


@ti.func
def pull(constants, pair):
    """Attraction [N]; the members of `pair` stand in core/effect.py."""
    return ti.select(pair.gap <= 0.0, constants.pull, 0.0)


def checks(probe: Probe) -> Iterator[Check]:
    """At least three statements; a parameter that is wrong by 10 % must break one of them."""
    strong = Params(pull_off=2e-6)
    yield Check("touching grains attract each other with F0", probe(strong, {}, gap=0.0), 2e-6)
    yield Check("an overlap does not change that", probe(strong, {}, gap=-1e-6), 2e-6)
    yield Check("half the strength is half the force", probe(strong, {}, strength=0.5, gap=0.0), 1e-6)
    yield Check("grains apart feel nothing", probe(strong, {}, gap=1e-9), 0.0)


EFFECT = Effect(
    name="constant_pull",
    title="constant pull between touching grains",
    doc=__doc__,
    place="pair",
    params=Params,
    act=pull,
    checks=checks,
    constants=constants,
)
