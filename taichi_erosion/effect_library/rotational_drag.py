"""Rotational drag: the air slows the spin of a grain relative to its own.

    T = -(c / 64) rho d^5 |w| w f,    w = spin - (1/2) curl u,    Re_w = rho d^2 |w| / mu
    f = 64 pi / Re_w                           Re_w < 32
    f = 12.9 / sqrt(Re_w) + 128.4 / Re_w       Re_w >= 32

with w the spin relative to the air [rad s-1], d the diameter [m], rho and mu density [kg m-3] and viscosity
[Pa s] of the air; c = 1. At small Re_w this is T = -pi mu d^3 w. In a wind along x that grows upwards, curl
u is (0, G, 0) with the shear G [s-1]. Without it spin is lost in impacts only; with it the spin of a 0.25
mm grain of quartz fades over rho_s d^2 / (60 mu) = 0.15 s. Strength multiplies the torque. Holds for Re_w <
1000.

Reference: Dennis, Singh & Ingham (1980), J. Fluid Mech. 101, 257; in this form Sommerfeld (2000),
Theoretical and Experimental Modelling of Particulate Flows, von Karman Institute, sec. 4.
"""

from dataclasses import dataclass
from math import pi

from taichi_erosion.core.effect import Check, Checks, Conditions, Constants, Probe, effect_of, quantity
from taichi_erosion.core.ti import ti


@dataclass(frozen=True)
class Params:
    coefficient: float = quantity(1.0, "1", "torque over that of a smooth sphere", low=0.0, high=3.0)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    return {"drag": strength * params.coefficient / 64.0}


@ti.func
def push(constants, grain):
    """Force [N] and torque [N m]."""
    spin = grain.spin
    spin[1] -= 0.5 * grain.air_shear
    rate = spin.norm()
    torque = 0.0 * spin
    if grain.air_viscosity > 0.0 and rate > 0.0:
        square = 4.0 * grain.radius * grain.radius
        reynolds = grain.air_density * square * rate / grain.air_viscosity
        resistance = 64.0 * pi * grain.air_viscosity * square
        if reynolds >= 32.0:
            resistance = (12.9 * ti.sqrt(reynolds) + 128.4) * grain.air_viscosity * square
        torque = -constants.drag * resistance * 2.0 * grain.radius * spin
    return 0.0 * torque, torque


def checks(probe: Probe) -> Checks:
    slowed = Params(coefficient=1.5)
    air = {"air_density": 1.2, "air_viscosity": 1.8e-5, "radius": 1e-4}

    def torque(spin: float, shear: float = 0.0, **changed: float) -> float:
        members = air | {"spin": (0.0, spin, 0.0), "air_shear": shear} | changed
        return probe(slowed, {}, **members)[1][1]

    slow = -1.5 * pi * 1.8e-5 * 8e-12 * 500.0
    # d = 2 mm, Re_w = 1.2 4e-6 1500 / 1.8e-5 = 400
    fast = -1.5 / 64.0 * 1.2 * (2e-3) ** 5 * 1500.0**2 * (12.9 / 20.0 + 128.4 / 400.0)
    yield Check("slow spin is resisted with pi mu d^3 w", torque(500.0), slow)
    yield Check("fast spin after Dennis et al.", torque(1500.0, radius=1e-3), fast)
    yield Check("air that turns spins up a grain at rest", torque(0.0, 1000.0), -slow)
    yield Check("a grain that turns with the air keeps its spin", torque(500.0, 1000.0), 0.0)


EFFECT = effect_of(__name__, "drag of the air on spin", "grain", push, through_air=True)
