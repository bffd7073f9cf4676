"""Dry adhesion: the van der Waals pull between grains that touch, at the strength that rough grains show.

    F = beta d_m / n,     d_m = 4 R*,     R* = R_i R_j / (R_i + R_j), of a wall R_i
    F falls linearly to zero over a gap of `range` times R*

with F the pull of one contact [N], beta the pull-off force of a whole grain over its diameter [N m-1], n the
contacts that share it [1] and d_m the diameter of two equal grains [m]. Smooth spheres with a surface energy
of 0.05 J m-2 would stick with 400 times the weight of a 0.1 mm grain; asperities keep them apart, and the
measured rise of thresholds below 0.15 mm gives beta = 1.5e-4 N m-1 instead, about the weight of such a grain.
In the source beta d adds to the weight of a grain: the threshold has g d + 6 beta / (pi rho_s d) in place of
g d. A grain in a pocket of three equal ones has three contacts at the angle a to the vertical with cos(a) =
sqrt(2/3), which hold it against a vertical lift with 3 cos(a) F = sqrt(6) F. Where it is tilted over two of
them, the third has the moment of sqrt(6) F in the centre. So n = sqrt(6); n = 1 is beta d in every contact.
The short range keeps the force continuous; it stores an energy of F range R* / 2 in every contact, which
must be small beside that of an impact. Strength multiplies the force. Holds for quartz in dry air.

Reference: Shao & Lu (2000), J. Geophys. Res. 105, 22437 (cohesion proportional to d); Kok & Renno (2006),
Geophys. Res. Lett. 33, L19S10 (beta); Kok & Renno (2009), J. Geophys. Res. 114, D17204, whose code adds it to
the weight (github.com/jfkok/COMSALT, `load_parameters.m`, `saltation_trajectory.m`).
"""

from dataclasses import dataclass
from math import sqrt

from taichi_erosion.core.effect import Check, Checks, Conditions, Constants, Probe, effect_of, quantity
from taichi_erosion.core.ti import ti

DIAMETER_OVER_EFFECTIVE = 4.0  # d / R* of two equal spheres [1]


@dataclass(frozen=True)
class Params:
    beta: float = quantity(1.5e-4, "N m-1", "pull-off force of a grain over its diameter", low=0.0, high=0.1)
    contacts: float = quantity(sqrt(6.0), "1", "pull-off of a grain over a contact's", low=1.0, high=12.0)
    range: float = quantity(1e-3, "1", "gap over R* at which it has vanished", low=1e-5, high=0.05)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    pull = strength * DIAMETER_OVER_EFFECTIVE * params.beta / params.contacts
    return {"pull": pull * conditions.get("adhesion_scale", 1.0), "range": params.range}


@ti.func
def pull(constants, pair):
    """Attraction [N]."""
    remainder = 1.0 - ti.max(pair.gap, 0.0) / (constants.range * pair.radius_effective)
    return constants.pull * pair.radius_effective * ti.max(remainder, 0.0)


def reach(constants: Constants, radius: float) -> float:
    """Gap at which the largest grains have let go of a wall [m]."""
    return constants["range"] * radius


def checks(probe: Probe) -> Checks:
    dry = Params(beta=3e-4, contacts=1.5, range=0.01)
    pulled = probe(Params(), {}, gap=0.0, radius_i=1e-4, radius_j=1e-4, radius_effective=5e-5)

    def force(gap: float, radius_j: float = 1e-4) -> float:
        effective = 1e-4 if radius_j == 0.0 else 1e-4 * radius_j / (1e-4 + radius_j)
        return probe(dry, {}, gap=gap, radius_i=1e-4, radius_j=radius_j, radius_effective=effective)

    yield Check("in a pocket of three beta d holds a grain", 3.0 * sqrt(2.0 / 3.0) * pulled, 1.5e-4 * 2e-4)
    yield Check("touching equal grains pull with beta d / n", force(0.0), 4e-8)
    yield Check("overlap does not change the pull", force(-1e-7), 4e-8)
    yield Check("half way through the range the pull is half", force(2.5e-7), 2e-8, rtol=1e-4)
    yield Check("beyond the range there is none", force(6e-7), 0.0)
    yield Check("a plane wall pulls twice as hard", force(0.0, radius_j=0.0), 8e-8)


EFFECT = effect_of(
    __name__,
    "van der Waals adhesion of rough dry grains",
    "pair",
    pull,
    expected={"repose_angle": 1, "threshold_u_star": 1},
)
