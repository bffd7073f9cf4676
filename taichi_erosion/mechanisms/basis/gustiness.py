"""Gustiness of the wind at the grains.

    sigma = strength D |u|

with sigma the standard deviation of the gusts along the wind [m s-1], u the mean wind at the grain [m s-1]
and D the dose [1]: the intensity of the turbulence. The gusts are the log-normal ones of the effect
turbulent_gusts, along the wind alone. Strength multiplies the dose. Holds for D from 0 to 1; a dose
below 0 means nothing.

Reference: Kok & Renno (2009), J. Geophys. Res. 114, D17204 (gusts at saltating grains).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe, quantity
from taichi_erosion.effects import turbulent_gusts

WIDEST = 1e6  # deviation over u* that no wind reaches: the intensity alone limits the gusts [1]


@dataclass(frozen=True)
class Params:
    dose: float = quantity(0.1, "1", "standard deviation of the wind over its mean", low=0.0, high=1.0)
    timescale: float = quantity(0.02, "s", "correlation time of a gust", low=1e-4, high=100.0)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica."""
    gusts = turbulent_gusts.constants(turbulent_gusts.Params(timescale=params.timescale), 1.0, conditions)
    along = {"deviation": WIDEST, "intensity": strength * params.dose}
    return gusts | along | {"upward": 0.0, "wall_upward": 0.0}


def checks(probe: Probe) -> Iterator[Check]:
    # probes have creeping flow, drag 3 pi mu d s; the grain is carried by the air
    air = {"air_density": 1e-6, "air_viscosity": 1.0, "radius": 1e-4, "chance": 0.375}
    stokes = 3.0 * pi * 2e-4

    def gust(time: float, strength: float = 1.0, wind: float = 4.0) -> float:
        carried = {"air_velocity": (wind, 0.0, 0.0), "velocity": (wind, 0.0, 0.0), "friction_velocity": 0.2}
        params = Params(dose=0.2, timescale=0.05)
        return probe(params, {}, strength=strength, time=time, **air, **carried)[0][0] / stokes

    yield Check(
        "a gust has the deviation D |u|", gust(0.03), 4.0 * turbulent_gusts.lognormal(0.2, 0.03), rtol=3e-3
    )
    yield Check("later it is another", gust(0.09), 4.0 * turbulent_gusts.lognormal(0.2, 0.09), rtol=3e-3)
    yield Check(
        "half the strength is half the dose",
        gust(0.09, 0.5),
        4.0 * turbulent_gusts.lognormal(0.1, 0.09),
        rtol=3e-3,
    )
    yield Check(
        "half the wind has half the gust",
        gust(0.09, wind=2.0),
        2.0 * turbulent_gusts.lognormal(0.2, 0.09),
        rtol=3e-3,
    )


EFFECT = Effect(
    name="gustiness",
    title="gusts of the wind",
    doc=__doc__,
    place="grain",
    params=Params,
    act=turbulent_gusts.push,
    checks=checks,
    constants=constants,
    gust=turbulent_gusts.gust,
)
