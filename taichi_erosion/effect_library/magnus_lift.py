"""Magnus lift: the force across the path of a spinning grain.

    F = c rho d^3 C w x (v - u),    w = spin - (1/2) curl u
    C = 1 - (0.675 + 0.15 (1 + tanh(0.28 (W - 2)))) tanh(0.18 sqrt(Re))
    W = |w| d / |v - u|,    Re = rho |v - u| d / mu

with w the spin relative to the air [rad s-1], v - u the velocity of the grain relative to the air [m s-1],
d the diameter [m], rho and mu density [kg m-3] and viscosity [Pa s] of the air; c = pi/8 for creeping flow
(C = 1). In a wind along x that grows upwards, curl u is (0, G, 0) with the shear G [s-1]. Back spin lifts a
grain that is faster than the air, forward spin one that the wind overtakes. Strength multiplies the force.
Holds for Re < 2000 and W < 10.

Reference: Rubinow & Keller (1961), J. Fluid Mech. 11, 447 (creeping flow); Loth (2008), AIAA J. 46, 801,
eqs (24)-(25).
"""

from dataclasses import dataclass
from math import pi, tanh

from taichi_erosion.core.effect import Check, Checks, Conditions, Constants, Probe, effect_of, quantity
from taichi_erosion.core.ti import ti

SLOWEST = 1e-9  # slip below which there is no lift [m s-1]


@dataclass(frozen=True)
class Params:
    coefficient: float = quantity(pi / 8.0, "1", "of a sphere in creeping flow", low=0.0, high=2.0)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    return {"lift": strength * params.coefficient}


@ti.func
def push(constants, grain):
    """Force [N] and torque [N m]."""
    diameter = 2.0 * grain.radius
    slip = grain.velocity - grain.air_velocity
    spin = grain.spin
    spin[1] -= 0.5 * grain.air_shear
    speed = ti.max(slip.norm(), SLOWEST)
    force = 0.0 * slip
    if grain.air_viscosity > 0.0:
        reynolds = grain.air_density * speed * diameter / grain.air_viscosity
        turn = spin.norm() * diameter / speed
        curb = 0.675 + 0.15 * (1.0 + ti.tanh(0.28 * (turn - 2.0)))
        factor = 1.0 - curb * ti.tanh(0.18 * ti.sqrt(reynolds))
        force = constants.lift * grain.air_density * diameter**3 * factor * spin.cross(slip)
    return force, 0.0 * force


def checks(probe: Probe) -> Checks:
    slow = Params(coefficient=0.4)
    air = {"air_density": 1.2, "air_viscosity": 1.8e-5, "radius": 1e-4}

    def lift(speed: float, spin: float, shear: float = 0.0) -> float:
        members = {"velocity": (speed, 0.0, 0.0), "spin": (0.0, spin, 0.0), "air_shear": shear}
        return probe(slow, {}, **air, **members)[0][2]

    creeping = 0.4 * 1.2 * 8e-12 * 500.0 * 1e-7
    # Re = 1.2 3 2e-4 / 1.8e-5 = 40, W = 3e4 2e-4 / 3 = 2
    curbed = 0.4 * 1.2 * 8e-12 * 3e4 * 3.0 * (1.0 - 0.825 * tanh(0.18 * 40.0**0.5))
    yield Check("back spin lifts a creeping grain", lift(1e-7, -500.0), creeping, rtol=2e-3)
    yield Check("at Re = 40 Loth's factor curbs the lift", lift(3.0, -3e4), curbed)
    yield Check("top spin presses down", lift(3.0, 3e4), -curbed)
    yield Check("a grain that turns with the air is not lifted", lift(3.0, 150.0, 300.0), 0.0)
    yield Check("spin relative to sheared air counts", lift(3.0, -2.9e4, 2e3), curbed)


EFFECT = effect_of(
    __name__, "Magnus lift of spinning grains", "grain", push, through_air=True, expected={"flux": 1}
)
