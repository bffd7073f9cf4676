"""Factor of a reading: an instrument, not physics.

    y_read = y (1 + strength D)

with y the value of the model and D the dose [1]: the gain of the instrument minus one. Strength multiplies
the dose. Holds for every reading alike; a discovery asks for one observable at a time.

Reference: JCGM 200 (2012), International vocabulary of metrology, 4.12 and 4.20 (sensitivity and bias).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Effect, Probe, quantity
from taichi_erosion.mechanisms.factors import factor_of


@dataclass(frozen=True)
class Params:
    dose: float = quantity(0.1, "1", "gain minus one", low=-0.95, high=9.0)


def read(params: Params, strength: float, conditions: Conditions, observable: str, value: float) -> float:
    """Value that the laboratory reads."""
    return value * factor_of(strength, params.dose)


def checks(probe: Probe) -> Iterator[Check]:
    def reading(dose: float, strength: float = 1.0) -> float:
        return probe(Params(dose=dose), {}, observable="flux", value=0.02, strength=strength)

    yield Check("a dose of 0.5 is a gain of 1.5", reading(0.5), 0.03)
    yield Check("half the strength is half the dose", reading(0.5, 0.5), 0.025)
    yield Check("a dose of -0.2 loses a fifth", reading(-0.2), 0.016)


EFFECT = Effect(
    name="reading_gain",
    title="a gain of the instrument",
    doc=__doc__,
    place="instrument",
    params=Params,
    act=read,
    checks=checks,
)
