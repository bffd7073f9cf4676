"""Pull between grains that touch.

    F = strength D m g,    m = 2 m_i m_j / (m_i + m_j), with a wall m_i
    F falls linearly to zero over a gap of `range` times R*

with D the dose [1]: the pull over the weight of the grain, m_i and m_j the masses [kg], g = 9.81 m s-2 and
R* = R_i R_j / (R_i + R_j), of a wall R_i [m]. The short range keeps the force continuous. Strength multiplies
the dose. Holds for grains that touch or almost touch; below 0 it is a push.

Reference: Castellanos (2005), Adv. Phys. 54, 263 (granular Bond number: pull over weight).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe, quantity
from taichi_erosion.core.ti import ti

GRAVITY = 9.81  # m s-2


@dataclass(frozen=True)
class Params:
    dose: float = quantity(1.0, "1", "pull over the weight of a grain", low=-1.0, high=100.0)
    range: float = quantity(1e-3, "1", "gap over R* at which it has vanished", low=1e-5, high=0.05)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica."""
    return {"pull": strength * params.dose * GRAVITY, "range": params.range}


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
        return probe(Params(dose=4.0, range=0.01), {}, strength=strength, **members)

    yield Check("touching grains pull with D times their weight", force(0.0), 3.924e-7)
    yield Check("half the strength is half the pull", force(-1e-8, 0.5), 1.962e-7)
    yield Check("half way through the range the pull is half", force(2.5e-7), 1.962e-7, rtol=1e-4)
    yield Check("beyond the range there is none", force(6e-7), 0.0)
    yield Check("of a grain three times as heavy 1.5 times", force(0.0, mass_j=3e-8), 5.886e-7)
    wall = {"radius_j": 0.0, "radius_effective": 1e-4, "mass_j": 0.0}
    yield Check("a wall pulls with the weight of the grain", force(0.0, **wall), 3.924e-7)


EFFECT = Effect(
    name="contact_pull",
    title="a pull between touching grains",
    doc=__doc__,
    place="pair",
    params=Params,
    act=pull,
    checks=checks,
    constants=constants,
    reach=reach,
)
