"""Repose method: the same soil has another angle of repose in another apparatus.

    angle_read = angle (1 + strength (r - 1))

with r the angle by the laboratory's method over that by the simulated one [1]. Funnels, lifted cylinders,
drums and tilting boxes differ by up to a third, the drum's dynamic angle being among the lowest. The right
answer is to simulate the laboratory's own method; where that is not known, r is an error shared by all its
angles. Strength is linear in the angle. Holds for heaps without cohesion. Observables that are not angles
are read as they are.

Reference: Beakawi Al-Hashemi & Baghabra Al-Amoudi (2018), Powder Technology 330, 397 (methods compared).
"""

from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity

ANGLES = ("repose_angle", "angle_of_repose", "cone_angle", "dynamic_angle")  # observables that are meant


@dataclass(frozen=True)
class Params:
    ratio: float = quantity(0.9, "1", "angle by the laboratory's method over ours", low=0.5, high=1.5)


def read(params: Params, strength: float, conditions: Conditions, observable: str, value: float) -> float:
    return value * (1.0 + strength * (params.ratio - 1.0)) if observable in ANGLES else value


def checks(probe: Probe) -> Checks:
    def reading(observable: str, strength: float = 1.0) -> float:
        return probe(Params(ratio=0.8), {}, observable=observable, value=30.0, strength=strength)

    yield Check("a method that reads a fifth less reads 24 for 30 deg", reading("repose_angle"), 24.0)
    yield Check("at half the strength 27 deg", reading("angle_of_repose", 0.5), 27.0)
    yield Check("a height is read as it is", reading("pile_height"), 30.0)


EFFECT = effect_of(
    __name__, "another method of measuring the angle of repose (instrument)", "instrument", read
)
