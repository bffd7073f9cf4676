"""Image force: a charged grain is drawn to a conducting wall by its mirror charge.

    F = q^2 / (4 pi eps0 (2 (R + s))^2) (1 - s / (n R)),    q = (q/m) m,    0 <= s < n R

with q the charge of the grain [C], q/m its charge over mass [C kg-1], m the mass [kg], R the radius [m], s
the gap to the wall [m], eps0 the vacuum permittivity [F m-1]. The bracket ends the force at n radii, where
a tenth of it is left for n = 2; at touch the force is exact. Overlap counts as touch. Pairs of grains are
left alone: the sum of their Coulomb forces hardly differs from zero in a bed of mixed signs, and no
neighbour list reaches as far. Strength multiplies the charge, so the force goes with its square. Holds for
dry grains on a wall that leads the charge away.

Reference: Jackson (1999), Classical Electrodynamics, 3rd ed., sec. 2.1 (image of a point charge before a
plane); Schmidt, Schmidt & Dent (1998), J. Geophys. Res. 103, 8997 (60 uC/kg on saltating sand).
"""

from dataclasses import dataclass
from math import pi

from taichi_erosion.core.effect import Check, Checks, Conditions, Constants, Probe, effect_of, quantity
from taichi_erosion.core.ti import ti

PERMITTIVITY = 8.8541878e-12  # of vacuum, eps0 [F m-1], CODATA 2018


@dataclass(frozen=True)
class Params:
    charge: float = quantity(6e-5, "C kg-1", "charge over mass of a grain, either sign", low=0.0, high=1e-3)
    range: float = quantity(2.0, "1", "gap over the radius at which the force ends", low=0.1, high=5.0)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    root = 1.0 / (16.0 * pi * PERMITTIVITY) ** 0.5
    return {"charge": strength * params.charge * root, "range": params.range}


@ti.func
def pull(constants, pair):
    """Attraction [N]."""
    attraction = 0.0
    if pair.radius_j == 0.0:
        gap = ti.max(pair.gap, 0.0)
        field = constants.charge * pair.mass_i / (pair.radius_i + gap)
        attraction = field * field * ti.max(1.0 - gap / (constants.range * pair.radius_i), 0.0)
    return attraction


def reach(constants: Constants, radius: float) -> float:
    """Gap at which the largest grain has left the wall's field [m]."""
    return constants["range"] * radius


def checks(probe: Probe) -> Checks:
    charged = Params(charge=1e-4, range=2.0)
    # q = 1e-12 C at 0.1 mm from the plane: (1e-12)^2 / (16 pi eps0 1e-8)
    touching = 1e-24 / (16.0 * pi * 8.8541878e-12 * 1e-8)

    def force(gap: float, radius_j: float = 0.0) -> float:
        return probe(charged, {}, gap=gap, radius_i=1e-4, radius_j=radius_j, mass_i=1e-8)

    yield Check("a touching grain is drawn with q^2 / (16 pi eps0 R^2)", force(0.0), touching)
    yield Check("one radius away a quarter is left, and half of that", force(1e-4), 0.125 * touching)
    yield Check("beyond the range there is nothing", force(2.1e-4), 0.0)
    yield Check("between two grains there is none", force(0.0, radius_j=1e-4), 0.0)


EFFECT = effect_of(__name__, "image force of charged grains at walls", "pair", pull, most=2.0)
