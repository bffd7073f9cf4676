"""Pull between grains across a gap.

    F = strength D m g (1 - s / (l d_m)),    0 <= s <= l d_m
    m = 2 m_i m_j / (m_i + m_j), with a wall m_i;    d_m = 4 R*

with D the dose [1]: the pull at touch over the weight of the grain, s the gap, not below 0 [m], l the range
over the diameter [1], d_m the diameter of two equal grains [m], m_i and m_j the masses [kg], g = 9.81 m s-2.
Strength multiplies the dose. Holds for grains whose neighbours lie within a few diameters; below 0 it is a
push.

Reference: Castellanos (2005), Adv. Phys. 54, 263 (granular Bond number: pull over weight).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe, quantity
from taichi_erosion.core.ti import ti

GRAVITY = 9.81  # m s-2
DIAMETER_OVER_EFFECTIVE = 4.0  # d / R* of two equal spheres [1]


@dataclass(frozen=True)
class Params:
    dose: float = quantity(1.0, "1", "pull at touch over the weight of a grain", low=-1.0, high=100.0)
    range: float = quantity(0.1, "1", "gap over the diameter at which it has vanished", low=0.01, high=1.0)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica."""
    pull = strength * params.dose * GRAVITY
    return {"pull": pull, "range": DIAMETER_OVER_EFFECTIVE * params.range}


@ti.func
def pull(constants, pair):
    """Attraction [N]."""
    mass = pair.mass_i
    if pair.mass_j > 0.0:
        mass = 2.0 * pair.mass_i * pair.mass_j / (pair.mass_i + pair.mass_j)
    left = 1.0 - ti.max(pair.gap, 0.0) / (constants.range * pair.radius_effective)
    return constants.pull * mass * ti.max(left, 0.0)


def reach(constants: Constants, radius: float) -> float:
    """Gap at which the largest grains have let go of a wall [m]."""
    return constants["range"] * radius


def checks(probe: Probe) -> Iterator[Check]:
    grains = {"radius_i": 1e-4, "radius_j": 1e-4, "radius_effective": 5e-5, "mass_i": 1e-8, "mass_j": 1e-8}

    def force(gap: float, strength: float = 1.0, **changed: float) -> float:
        members = grains | {"gap": gap} | changed
        return probe(Params(dose=4.0, range=0.2), {}, strength=strength, **members)

    yield Check("touching grains pull with D times their weight", force(0.0), 3.924e-7)
    yield Check("half the strength is half the pull", force(-1e-8, 0.5), 1.962e-7)
    yield Check("a tenth of a diameter away the pull is half", force(2e-5), 1.962e-7, rtol=1e-4)
    yield Check("beyond the range there is none", force(5e-5), 0.0)
    wall = {"radius_j": 0.0, "radius_effective": 1e-4, "mass_j": 0.0}
    yield Check("a wall counts as a grain of twice the diameter", force(4e-5, **wall), 1.962e-7, rtol=1e-4)


EFFECT = Effect(
    name="gap_pull",
    title="a pull between grains across a gap",
    doc=__doc__,
    place="pair",
    params=Params,
    act=pull,
    checks=checks,
    constants=constants,
    reach=reach,
)
