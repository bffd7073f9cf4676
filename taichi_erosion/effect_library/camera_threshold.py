"""Camera threshold: the amount of movement at which an observer states that sand moves.

    u*_read = u*_t (N / N_t)^(strength / n)

with u*_t the threshold of the simulation, at N_t grains moving, N the number at which the observer or
camera detects movement, N / N_t the criterion [1], and n the exponent with which movement grows with the
wind around the threshold [1], 10 to 20. Thresholds of stress get the square. Strength multiplies the
logarithm. A criterion below 1 reads earlier than the simulation does. Other observables are read as they
are. Holds near the threshold.

Reference: Nickling (1988), Sedimentology 35, 499 (grains that move against u*); Lyles & Krauss (1971),
Trans. ASAE 14, 563 (stages of motion).
"""

from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity


@dataclass(frozen=True)
class Params:
    criterion: float = quantity(5.0, "1", "grains seen over grains that move", low=1e-3, high=1e3)
    exponent: float = quantity(15.0, "1", "of movement against u*", low=2.0, high=50.0)


def read(params: Params, strength: float, conditions: Conditions, observable: str, value: float) -> float:
    if "threshold" not in observable:
        return value
    power = 2.0 if observable.endswith("stress") else 1.0
    return value * params.criterion ** (power * strength / params.exponent)


def checks(probe: Probe) -> Checks:
    camera = Params(criterion=16.0, exponent=4.0)

    def reading(observable: str, strength: float = 1.0) -> float:
        return probe(camera, {}, observable=observable, value=0.2, strength=strength)

    yield Check("sixteen times the grains move at twice the wind", reading("threshold_u_star"), 0.4)
    yield Check("which is four times the stress", reading("fluid_threshold_stress"), 0.8)
    yield Check("half the strength is the root of the factor", reading("threshold_u_star", 0.5), 0.08**0.5)
    yield Check("a flux is read as it is", reading("flux"), 0.2)


EFFECT = effect_of(
    __name__,
    "criterion of the observer of a threshold (instrument)",
    "instrument",
    read,
    most=2.0,
    expected={"threshold_u_star": 1},
)
