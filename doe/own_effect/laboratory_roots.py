"""Roots as the laboratory of doe/own_effect has them; docs/write_an_effect.md writes an effect of its own.

    F = T R / rho    s <= 0
    F = 0            s > 0

with T the pull of a contact that is all roots [N], R the dry mass of roots over the volume of soil [kg m-3],
rho the density of dry roots [kg m-3], s the gap [m]. Strength multiplies F. Holds for thin roots.

Reference: Wu, McKinnell & Swanston (1979), Can. Geotech. J. 16, 19 (strength grows with the area of roots).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe, quantity
from taichi_erosion.core.ti import ti


@dataclass(frozen=True)
class Params:
    tensile: float = quantity(1.3e-3, "N", "pull of a contact that is all roots", low=0.0, high=1e3)
    density: float = quantity(500.0, "kg m-3", "density of dry roots", low=100.0, high=1500.0)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Pull of a contact [N]."""
    return {"pull": strength * params.tensile * conditions.get("root_density", 0.0) / params.density}


@ti.func
def pull(constants, pair):
    """Attraction [N]."""
    return ti.select(pair.gap <= 0.0, constants.pull, 0.0)


def checks(probe: Probe) -> Iterator[Check]:
    """Three statements about the law."""
    soil = Params(tensile=2.0, density=400.0)
    yield Check("as strong as T R / rho", probe(soil, {"root_density": 10.0}, gap=0.0), 0.05)
    yield Check("without roots nothing", probe(soil, {}, gap=0.0), 0.0)
    yield Check("across a gap nothing", probe(soil, {"root_density": 10.0}, gap=1e-9), 0.0)


EFFECT = Effect(
    name="laboratory_roots",
    title="roots of the laboratory",
    doc=__doc__,
    place="pair",
    params=Params,
    act=pull,
    checks=checks,
    constants=constants,
    reads=("root_density",),
)
