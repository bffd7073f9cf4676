"""Turbulent gusts: the drag of a wind that fluctuates about its mean.

    F = m b(|s'|) s' - m b(|s|) s,    s = u - v,    s' = s + sigma (g_1, 0, r g_2)
    sigma  = min(a u*, i |u|)
    g      = sqrt(2/K) sum_k cos(w_k t + p_k),    w_k = tan(pi (k - 1/2) / (2 K)) / T,    k = 1 .. K

with u the mean wind at the grain, v the velocity of the grain [m s-1], u* the friction velocity [m s-1],
m the mass of the grain [kg], b the rate of the run's law of drag [s-1]. Near the ground a = 2.5 and r a =
1.4; i is the largest intensity, which holds where the wind is weak between grains. g_1 and g_2 are
stationary processes of variance 1 and correlation exp(-t / T), those of the Langevin equation dg = -g
dt/T + sqrt(2/T) dW, as a sum of waves: it needs no memory of every grain, and the whole patch feels one
gust, as it does where eddies are larger than it. T is 0.3 to 1 times depth over speed of the layer: 0.02
s in a tunnel, seconds outdoors. The phases p_k follow from the seed. Strength multiplies a. Holds for
grains much smaller than eddies.

Reference: Kok & Renno (2009), J. Geophys. Res. 114, D17204 (sigma and the Langevin equation); Shinozuka &
Deodatis (1991), Appl. Mech. Rev. 44, 191 (processes as sums of waves).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, pi, sqrt, tan

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe, quantity
from taichi_erosion.core.ti import ti

WAVES = 24  # K; correlations are then right to 0.04 [1]
FREQUENCIES = tuple(tan(0.5 * pi * (k + 0.5) / WAVES) for k in range(WAVES))  # w_k T [1]
SQUARE = (7919.0, 5003.0)  # factors of the seed's number in the phases of both processes [1]
CUBE = (3571.0, 9973.0)


@dataclass(frozen=True)
class Params:
    deviation: float = quantity(2.5, "1", "of the wind along itself, over u*", low=0.0, high=5.0)
    upward: float = quantity(0.56, "1", "vertical over streamwise deviation", low=0.0, high=1.0)
    intensity: float = quantity(0.4, "1", "largest deviation over the mean wind", low=0.0, high=1.0)
    timescale: float = quantity(0.02, "s", "correlation time of a gust", low=1e-4, high=100.0)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica; at strength 0 the wind is steady."""
    return {
        "deviation": strength * params.deviation,
        "upward": params.upward,
        "intensity": params.intensity,
        "rate": 1.0 / params.timescale,
    }


@ti.func
def wave_sum(time, square, cube):
    """Process of variance 1 [1] at a time in units of T; phases are k^2 square + k^3 cube turns."""
    total = 0.0 * time
    for k in ti.static(range(1, WAVES + 1)):
        phase = (square * (k * k)) % 1.0 + (cube * (k * k * k)) % 1.0
        total += ti.cos(FREQUENCIES[k - 1] * time + 2.0 * pi * phase)
    return ti.sqrt(2.0 / WAVES) * total


@ti.func
def push(constants, grain):
    """Force [N] and torque [N m]."""
    force = 0.0 * grain.velocity
    mean = grain.air_velocity.norm()
    deviation = ti.min(constants.deviation * grain.friction_velocity, constants.intensity * mean)
    if grain.air_viscosity > 0.0 and deviation > 0.0:
        time = grain.time * constants.rate
        slip = grain.air_velocity - grain.velocity
        gusty = slip
        gusty[0] += deviation * wave_sum(time, grain.chance * SQUARE[0] % 1.0, grain.chance * CUBE[0] % 1.0)
        rise = wave_sum(time, grain.chance * SQUARE[1] % 1.0, grain.chance * CUBE[1] % 1.0)
        gusty[2] += deviation * constants.upward * rise
        force = grain.drag(gusty) - grain.drag(slip)
    return force, 0.0 * force


def checks(probe: Probe) -> Iterator[Check]:
    # probes have creeping flow, drag 3 pi mu d s; the grain is carried by the air
    air = {
        "air_density": 1e-6,
        "air_viscosity": 1.0,
        "radius": 1e-4,
        "friction_velocity": 0.2,
        "chance": 0.375,
    }
    stokes = 3.0 * pi * 2e-4
    gusty = Params(deviation=2.0, upward=0.5, intensity=0.5, timescale=0.05)

    def gust(axis: int, time: float, wind: float = 4.0) -> float:
        carried = {"air_velocity": (wind, 0.0, 0.0), "velocity": (wind, 0.0, 0.0)}
        return probe(gusty, {}, time=time, **air, **carried)[0][axis] / stokes

    def wave(axis: int, time: float) -> float:
        square, cube = (0.375 * (SQUARE, CUBE)[n][axis] for n in range(2))
        terms = (
            cos(tan(pi * (k - 0.5) / 48.0) * time / 0.05 + 2.0 * pi * (square * k**2 + cube * k**3))
            for k in range(1, 25)
        )
        return sum(terms) / sqrt(12.0)

    yield Check("a gust along the wind has the deviation a u*", gust(0, 0.03), 0.4 * wave(0, 0.03), rtol=3e-3)
    yield Check("later it is another", gust(0, 0.09), 0.4 * wave(0, 0.09), rtol=3e-3)
    yield Check("upwards it is weaker", gust(2, 0.03), 0.2 * wave(1, 0.03), rtol=3e-3)
    yield Check("a weak wind has weak gusts", gust(0, 0.03, 0.1), 0.05 * wave(0, 0.03), rtol=3e-3)


EFFECT = Effect(
    name="turbulent_gusts",
    title="drag of gusts (Langevin statistics)",
    doc=__doc__,
    place="grain",
    params=Params,
    act=push,
    checks=checks,
    constants=constants,
    expected={"threshold_u_star": -1, "flux": 1},
)
