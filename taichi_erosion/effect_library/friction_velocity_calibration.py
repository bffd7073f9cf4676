"""Friction velocity calibration: one error shared by every wind that a laboratory states.

    u*_read = c u*,    c = 1 + strength (r - 1)
    thresholds of u* or wind speed are read as c times, thresholds of stress as c^2 times the true ones
    fluxes, stated at the u* that was read, belong to a weaker wind:  Q_read = Q c^-n

with r the ratio of the friction velocity that is read to the true one [1] and n the exponent with which the
flux grows with u* [1], 2 far above the threshold and more near it. Friction velocities come from a wind
profile and are known to 5 or 10 %; the error is the same in every row of one laboratory. Strength is linear
in c. Holds for errors of a few tens of per cent.

Reference: Lee & Baas (2012), Earth Surf. Process. Landforms 37, 1349 (u* from profiles); Creyssels et al.
(2009), J. Fluid Mech. 625, 47 (flux linear in stress).
"""

from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity


@dataclass(frozen=True)
class Params:
    ratio: float = quantity(1.07, "1", "friction velocity as read over the true one", low=0.5, high=2.0)
    exponent: float = quantity(2.0, "1", "with which the flux grows with u*", low=0.0, high=6.0)


def read(params: Params, strength: float, conditions: Conditions, observable: str, value: float) -> float:
    factor = 1.0 + strength * (params.ratio - 1.0)
    if "threshold" in observable:
        return value * (factor * factor if observable.endswith("stress") else factor)
    return value * factor**-params.exponent if "flux" in observable else value


def checks(probe: Probe) -> Checks:
    gauge = Params(ratio=1.2, exponent=3.0)

    def reading(observable: str, strength: float = 1.0) -> float:
        return probe(gauge, {}, observable=observable, value=1.0, strength=strength)

    yield Check("a threshold of u* is read 1.2 times", reading("threshold_u_star"), 1.2)
    yield Check("one of stress 1.44 times", reading("impact_threshold_stress"), 1.44)
    yield Check("a flux belongs to a weaker wind", reading("flux"), 1.2**-3)
    yield Check("half the strength is half the error", reading("threshold_u_star", 0.5), 1.1)
    yield Check("an angle is read as it is", reading("repose_angle"), 1.0)


EFFECT = effect_of(
    __name__,
    "calibration error of the friction velocity (instrument)",
    "instrument",
    read,
    expected={"threshold_u_star": 1, "flux": -1},
)
