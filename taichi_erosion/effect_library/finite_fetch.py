"""Finite fetch: a flux measured before the wind has picked up all it can carry.

    Q_read = Q (1 - exp(-x / L)),    L = strength a d rho_s / rho

with Q the saturated flux of a long bed, x the length of sand upwind of the trap [m], L the saturation
length [m], d the grain diameter [m], rho_s and rho the densities of grains and air, a a number near 2 [1].
A periodic patch has no fetch: its flux is the saturated one, and a short bed in a tunnel reads less. The
fetch is that of the conditions, the diameter that of the conditions or of the scene, and the densities are
those of the scene; the parameters stand in for what neither states, as in a model that is a function.
Strength multiplies L. Holds for beds without a supply limit, to first order: near an edge the flux grows
more slowly. Reads fluxes alone.

Reference: Andreotti, Claudin & Pouliquen (2010), Geomorphology 123, 343 (L = 2.2 d rho_s / rho).
"""

from dataclasses import dataclass
from math import exp

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity

READ = "flux"  # observables of this name


@dataclass(frozen=True)
class Params:
    saturation: float = quantity(2.2, "1", "saturation length over d rho_s / rho", low=0.1, high=20.0)
    density_ratio: float = quantity(2200.0, "1", "where there is no scene with wind", low=100.0, high=2e5)
    fetch: float = quantity(4.0, "m", "where the conditions state none", low=1e-2, high=1e5)
    diameter: float = quantity(
        2.5e-4, "m", "where neither conditions nor scene state it", low=1e-6, high=1e-2
    )


def read(params: Params, strength: float, conditions: Conditions, observable: str, value: float) -> float:
    if READ not in observable or strength == 0.0:
        return value
    diameter = conditions.get("diameter", conditions.get("grain_diameter", params.diameter))
    length = strength * params.saturation * diameter * conditions.get("density_ratio", params.density_ratio)
    return value * (1.0 - exp(-conditions.get("fetch", params.fetch) / length))


def checks(probe: Probe) -> Checks:
    bed = Params(saturation=2.0, density_ratio=2500.0, fetch=1.5, diameter=3e-4)  # L = 1.5 m

    def reading(value: float, observable: str = "flux", strength: float = 1.0, **conditions: float) -> float:
        return probe(bed, conditions, observable=observable, value=value, strength=strength)

    yield Check("one saturation length of sand carries 1 - 1/e of the flux", reading(0.01), 6.3212056e-3)
    yield Check("twice the fetch carries more", reading(0.01, fetch=3.0), 8.6466472e-3)
    yield Check("coarser sand saturates later", reading(0.01, diameter=6e-4), 3.9346934e-3)
    yield Check("half the strength is half the length", reading(0.01, strength=0.5), 8.6466472e-3)
    yield Check("the sand of the scene counts", reading(0.01, grain_diameter=6e-4), 3.9346934e-3)
    yield Check("so does its density over that of the air", reading(0.01, density_ratio=5000.0), 3.9346934e-3)
    yield Check("a threshold is read as it is", reading(0.3, "threshold_u_star"), 0.3)


EFFECT = effect_of(
    __name__,
    "flux of a bed too short to saturate (instrument)",
    "instrument",
    read,
    reads=("fetch", "diameter"),
    expected={"flux": -1},
)
