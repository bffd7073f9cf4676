"""Dry adhesion: the van der Waals pull between grains that touch, at the strength that rough grains show.

    F = beta d_m,     d_m = 4 R*,     R* = R_i R_j / (R_i + R_j), of a wall R_i
    F falls linearly to zero over a gap of `range` times R*

with beta the pull-off force over grain diameter [N m-1] and d_m the diameter of two equal grains [m].
Smooth spheres with a surface energy of 0.05 J m-2 would stick with 400 times the weight of a 0.1 mm grain;
asperities keep them apart, and the measured rise of thresholds below 0.15 mm gives beta = 1.5e-4 N m-1
instead, about the weight of such a grain. The short range keeps the force continuous; it stores an energy
of F range R* / 2 in every contact, which must be small beside that of an impact. Strength multiplies the
force. Holds for quartz in dry air.

Reference: Shao & Lu (2000), J. Geophys. Res. 105, 22437 (cohesion proportional to d); Kok & Renno (2009),
J. Geophys. Res. 114, D17204 (beta).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe, quantity
from taichi_erosion.core.ti import ti

DIAMETER_OVER_EFFECTIVE = 4.0  # d / R* of two equal spheres [1]


@dataclass(frozen=True)
class Params:
    beta: float = quantity(1.5e-4, "N m-1", "pull-off force over diameter", low=0.0, high=0.1)
    range: float = quantity(1e-3, "1", "gap over R* at which it has vanished", low=1e-5, high=0.05)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica."""
    return {"pull": strength * DIAMETER_OVER_EFFECTIVE * params.beta, "range": params.range}


@ti.func
def pull(constants, pair):
    """Attraction [N]."""
    left = 1.0 - ti.max(pair.gap, 0.0) / (constants.range * pair.radius_effective)
    return constants.pull * pair.radius_effective * ti.max(left, 0.0)


def reach(constants: Constants, radius: float) -> float:
    """Gap at which the largest grains have let go of a wall [m]."""
    return constants["range"] * radius


def checks(probe: Probe) -> Iterator[Check]:
    dry = Params(beta=2e-4, range=0.01)

    def force(gap: float, radius_j: float = 1e-4) -> float:
        effective = 1e-4 if radius_j == 0.0 else 1e-4 * radius_j / (1e-4 + radius_j)
        return probe(dry, {}, gap=gap, radius_i=1e-4, radius_j=radius_j, radius_effective=effective)

    yield Check("touching equal grains pull with beta d", force(0.0), 4e-8)
    yield Check("overlap does not change the pull", force(-1e-7), 4e-8)
    yield Check("half way through the range the pull is half", force(2.5e-7), 2e-8, rtol=1e-4)
    yield Check("beyond the range there is none", force(6e-7), 0.0)
    yield Check("a plane wall pulls twice as hard", force(0.0, radius_j=0.0), 8e-8)


EFFECT = Effect(
    name="dry_adhesion",
    title="van der Waals adhesion of rough dry grains",
    doc=__doc__,
    place="pair",
    params=Params,
    act=pull,
    checks=checks,
    constants=constants,
    reach=reach,
    expected={"repose_angle": 1, "threshold_u_star": 1},
)
