"""Lift of grains along the shear of the wind.

    F = strength D 1.615 d^2 sqrt(rho mu |G|) (-s_z, 0, s_x) G/|G|

with D the dose [1]: the lift over that of Saffman, s = u - v the velocity of the air relative to the grain
[m s-1], G = du/dz [s-1], d the diameter [m], rho and mu density [kg m-3] and viscosity [Pa s] of the air.
Strength multiplies the dose. Holds for grains in a sheared wind; no correction for larger Reynolds numbers.

Reference: Saffman (1965), J. Fluid Mech. 22, 385.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe, quantity
from taichi_erosion.core.ti import ti

SAFFMAN = 1.615  # coefficient of Saffman's lift [1]


@dataclass(frozen=True)
class Params:
    dose: float = quantity(1.0, "1", "lift over that of Saffman", low=-5.0, high=20.0)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica."""
    return {"coefficient": strength * params.dose * SAFFMAN}


@ti.func
def push(constants, grain):
    """Force [N] and torque [N m]."""
    slip = grain.air_velocity - grain.velocity
    force = 0.0 * slip
    root = ti.sqrt(grain.air_density * grain.air_viscosity * ti.abs(grain.air_shear))
    size = constants.coefficient * 4.0 * grain.radius * grain.radius * root
    signed = ti.select(grain.air_shear >= 0.0, size, -size)
    force[0] = -signed * slip[2]
    force[2] = signed * slip[0]
    return force, 0.0 * force


def checks(probe: Probe) -> Iterator[Check]:
    air = {"air_density": 1.2, "air_viscosity": 1.8e-5, "radius": 1e-4}

    def force(axis: int, shear: float, wind: tuple[float, float, float], strength: float = 1.0) -> float:
        members = air | {"air_velocity": wind, "air_shear": shear}
        return probe(Params(dose=2.0), {}, strength=strength, **members)[0][axis]

    saffman = 1.615 * 4e-8 * (1.2 * 1.8e-5 * 300.0) ** 0.5
    yield Check("twice Saffman's lift", force(2, 300.0, (0.3, 0.0, 0.0)), 2.0 * saffman * 0.3)
    yield Check("half the strength is half the dose", force(2, 300.0, (0.3, 0.0, 0.0), 0.5), saffman * 0.3)
    yield Check("rising air pushes upstream", force(0, 300.0, (0.0, 0.0, 0.2)), -2.0 * saffman * 0.2)
    yield Check("a shear that falls upwards presses down", force(2, -300.0, (0.3, 0, 0)), -2 * saffman * 0.3)


EFFECT = Effect(
    name="lift",
    title="a lift along the shear",
    doc=__doc__,
    place="grain",
    params=Params,
    act=push,
    checks=checks,
    constants=constants,
)
