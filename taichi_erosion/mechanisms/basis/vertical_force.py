"""Vertical force on grains.

    F_z = strength D m g

with D the dose [1]: the force upwards over the weight of the grain, m its mass [kg], g = 9.81 m s-2. Strength
multiplies the dose. Holds for every grain alike; below 0 it presses down. The inertia of the grain stays, as
it does not under a factor of its weight.

Reference: Schmidt, Schmidt & Dent (1998), J. Geophys. Res. 103, 8997 (forces on grains over their weight).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe, quantity
from taichi_erosion.core.ti import ti

GRAVITY = 9.81  # m s-2


@dataclass(frozen=True)
class Params:
    dose: float = quantity(0.2, "1", "force upwards over the weight of a grain", low=-5.0, high=0.95)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica."""
    return {"acceleration": strength * params.dose * GRAVITY}


@ti.func
def push(constants, grain):
    """Force [N] and torque [N m]."""
    force = 0.0 * grain.velocity
    force[2] = constants.acceleration * grain.mass
    return force, 0.0 * force


def checks(probe: Probe) -> Iterator[Check]:
    def force(axis: int, mass: float = 1e-8, strength: float = 1.0) -> float:
        return probe(Params(dose=0.5), {}, strength=strength, mass=mass)[0][axis]

    yield Check("half the weight, upwards", force(2), 4.905e-8)
    yield Check("half the strength is half the dose", force(2, strength=0.5), 2.4525e-8)
    yield Check("a heavier grain is pushed more", force(2, 2e-8), 9.81e-8)
    yield Check("nothing along the wind", force(0), 0.0)


EFFECT = Effect(
    name="vertical_force",
    title="a vertical force",
    doc=__doc__,
    place="grain",
    params=Params,
    act=push,
    checks=checks,
    constants=constants,
)
