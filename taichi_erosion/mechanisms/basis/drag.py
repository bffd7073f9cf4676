"""Factor of the drag on grains.

    F' = F (1 + strength D)

with F the drag of the run's law [N] and D the dose [1]: the factor minus one. The air loses the momentum that
the grains gain. Strength multiplies the dose. Holds for doses above -1.

Reference: Di Felice (1994), Int. J. Multiphase Flow 20, 153 (drag on grains among grains).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe, quantity
from taichi_erosion.core.ti import ti
from taichi_erosion.mechanisms.factors import factor_of


@dataclass(frozen=True)
class Params:
    dose: float = quantity(0.5, "1", "factor minus one", low=-0.95, high=9.0)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica."""
    return {"more": factor_of(strength, params.dose) - 1.0}


@ti.func
def factor(constants, grain):
    """Factor of the drag [1]."""
    return 1.0 + constants.more


@ti.func
def push(constants, grain):
    """No force besides the drag [N], and no torque [N m]."""
    return 0.0 * grain.velocity, 0.0 * grain.velocity


def checks(probe: Probe) -> Iterator[Check]:
    # probes have creeping flow, drag 3 pi mu d u
    air = {"air_density": 1.2, "air_viscosity": 1.8e-5, "radius": 1e-4, "air_velocity": (0.5, 0.0, 0.0)}
    stokes = 3.0 * pi * 1.8e-5 * 2e-4 * 0.5

    def gained(dose: float, strength: float = 1.0) -> float:
        return probe(Params(dose=dose), {}, strength=strength, **air)[0][0] / stokes

    yield Check("a dose of 0.5 adds half the drag", gained(0.5), 0.5)
    yield Check("half the strength is half the dose", gained(0.5, 0.5), 0.25)
    yield Check("a negative dose takes drag away", gained(-0.4), -0.4)


EFFECT = Effect(
    name="drag",
    title="a factor of drag",
    doc=__doc__,
    place="grain",
    params=Params,
    act=push,
    checks=checks,
    constants=constants,
    drag=factor,
)
