"""Offset of a reading: an instrument, not physics.

    y_read = y + strength D s

with y the value of the model, s the scale, in the unit of the reading, and D the dose [1]: the offset over
the scale. Strength multiplies the dose. Holds for every reading alike; a discovery asks for one observable at
a time, and takes the median of its readings as the scale.

Reference: JCGM 200 (2012), International vocabulary of metrology, 4.20 (instrumental bias).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Effect, Probe, quantity


@dataclass(frozen=True)
class Params:
    dose: float = quantity(0.1, "1", "offset over the scale", low=-10.0, high=10.0)
    scale: float = quantity(1.0, "unit of the reading", "offset of a dose of 1", low=1e-12, high=1e12)


def read(params: Params, strength: float, conditions: Conditions, observable: str, value: float) -> float:
    """Value that the laboratory reads."""
    return value + strength * params.dose * params.scale


def checks(probe: Probe) -> Iterator[Check]:
    def reading(dose: float, strength: float = 1.0) -> float:
        params = Params(dose=dose, scale=2.0)
        return probe(params, {}, observable="repose_angle", value=30.0, strength=strength)

    yield Check("a dose of 4 is four times the scale", reading(4.0), 38.0, rtol=1e-9)
    yield Check("half the strength is half the dose", reading(4.0, 0.5), 34.0)
    yield Check("a negative dose is subtracted", reading(-5.0), 20.0)


EFFECT = Effect(
    name="reading_offset",
    title="an offset of the instrument",
    doc=__doc__,
    place="instrument",
    params=Params,
    act=read,
    checks=checks,
)
