"""Trap efficiency: the share of the blowing sand that a trap catches.

    Q_read = Q max(0, 1 - strength l exp(1 - d / d_r) (u* / u*_r))

with Q the true flux, d the grain diameter [m], u* the friction velocity [m s-1], and l the loss [1] at the
reference diameter d_r [m] and friction velocity u*_r [m s-1]. Air that a trap dams up flows around it and
takes fine grains along, more of them in stronger wind. The form is a plausible one; measured efficiencies
of sand traps lie between 0.7 and 1.2 and depend on both. Diameter and friction velocity are those of the
conditions, or the references where they state none. Strength multiplies the loss. Holds for sand of 0.1 to
1 mm. Reads fluxes alone.

Reference: Goossens, Offer & London (2000), Geomorphology 35, 299 (five sand traps in tunnel and field);
Shao, McTainsh, Leys & Raupach (1993), Aust. J. Soil Res. 31, 519.
"""

from dataclasses import dataclass
from math import exp

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity

READ = "flux"  # observables of this name


@dataclass(frozen=True)
class Params:
    loss: float = quantity(0.2, "1", "share that escapes at the references", low=0.0, high=1.0)
    diameter: float = quantity(2.5e-4, "m", "reference diameter", low=1e-6, high=1e-2)
    friction_velocity: float = quantity(0.4, "m s-1", "reference friction velocity", low=0.01, high=5.0)


def read(params: Params, strength: float, conditions: Conditions, observable: str, value: float) -> float:
    if READ not in observable:
        return value
    size = conditions.get("diameter", params.diameter) / params.diameter
    wind = conditions.get("friction_velocity", params.friction_velocity) / params.friction_velocity
    return value * max(0.0, 1.0 - strength * params.loss * exp(1.0 - size) * wind)


def checks(probe: Probe) -> Checks:
    trap = Params(loss=0.3, diameter=2e-4, friction_velocity=0.5)

    def reading(observable: str = "flux", strength: float = 1.0, **conditions: float) -> float:
        return probe(trap, conditions, observable=observable, value=0.02, strength=strength)

    yield Check("at the references a trap misses its loss", reading(), 0.014)
    yield Check("at half the strength half of it", reading(strength=0.5), 0.017)
    yield Check("coarser sand by one reference escapes less by e", reading(diameter=4e-4), 0.01779272)
    yield Check("a stronger wind takes more along", reading(friction_velocity=0.75), 0.011)
    yield Check("more than all cannot escape", reading(strength=4.0), 0.0)
    yield Check("an angle is read as it is", reading("repose_angle"), 0.02)


EFFECT = effect_of(
    __name__,
    "efficiency of the sand trap (instrument)",
    "instrument",
    read,
    reads=("diameter", "friction_velocity"),
    expected={"flux": -1},
)
