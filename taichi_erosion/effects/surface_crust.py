"""Surface crust: grains that have touched are cemented, and a bond breaks when it is pulled too far.

    F = sigma pi (b R)^2 s / s_b,    0 < s < s_b = x R,    R = 2 R_i R_j / (R_i + R_j), of a wall 2 R_i
    F = 0 once the gap s has reached s_b

with sigma the tensile strength of the cement [Pa], b the radius of the neck over R [1] and x the strain at
which it breaks [1]. The bond neither pulls nor pushes at s = 0 and holds with its full strength just before
it breaks. Two grains that touch again are cemented again: the crust heals, as one of wet clay does; a bond
that stays broken would need a memory that outlives the contact. Strength multiplies sigma. Holds for thin
necks, b well below 1, and s_b longer than the way that grains go in one time step.

Reference: Rice & McEwan (2001), Earth Surf. Process. Landforms 26, 721 (strength of crusts, 1e3 to 1e5 Pa);
Potyondy & Cundall (2004), Int. J. Rock Mech. Min. Sci. 41, 1329, eq. (15) (bonds of a neck's
cross-section).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe
from taichi_erosion.core.quantity import quantity
from taichi_erosion.core.ti import ti


@dataclass(frozen=True)
class Params:
    tensile_strength: float = quantity(1e4, "Pa", "of the cement", low=0.0, high=1e7)
    neck: float = quantity(0.1, "1", "radius of a neck over R", low=1e-3, high=0.5)
    strain: float = quantity(0.01, "1", "gap over R at which a bond breaks", low=1e-4, high=0.2)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica."""
    return {
        "stress": strength * params.tensile_strength * pi * params.neck**2,  # full force over R^2 [Pa]
        "strain": params.strain,
    }


@ti.func
def pull(constants, pair):
    """Attraction [N]."""
    radius = 2.0 * pair.radius_effective
    longest = constants.strain * radius
    attraction = 0.0
    if pair.met > 0.0 and pair.gap > 0.0 and pair.gap < longest:
        attraction = constants.stress * radius * radius * pair.gap / longest
    return attraction


def reach(constants: Constants, radius: float) -> float:
    """Longest bond, of the largest grain with a wall [m]."""
    return 2.0 * constants["strain"] * radius


def checks(probe: Probe) -> Iterator[Check]:
    crust = Params(tensile_strength=2e4, neck=0.05, strain=0.02)
    full = 2e4 * pi * (0.05 * 1e-4) ** 2  # two grains of 0.1 mm radius: R = 0.1 mm

    def force(gap: float, radius_j: float = 1e-4, met: float = 1.0) -> float:
        effective = 1e-4 if radius_j == 0.0 else 1e-4 * radius_j / (1e-4 + radius_j)
        return probe(
            crust, {}, gap=gap, radius_i=1e-4, radius_j=radius_j, radius_effective=effective, met=met
        )

    yield Check("half way to breaking a bond holds with half its strength", force(1e-6), 0.5 * full)
    yield Check("just before it breaks it holds with all of it", force(1.999e-6), 0.9995 * full)
    yield Check("a broken bond holds nothing", force(2.001e-6), 0.0)
    yield Check("grains that never met are not cemented", force(1e-6, met=0.0), 0.0)
    yield Check("touching grains feel no bond", force(-1e-7), 0.0)
    yield Check("the neck to a wall has four times the section", force(3.998e-6, 0.0), 3.998 * full, 1e-4)


EFFECT = Effect(
    name="surface_crust",
    title="crust of cemented grains",
    doc=__doc__,
    place="pair",
    params=Params,
    act=pull,
    checks=checks,
    constants=constants,
    reach=reach,
    expected={"threshold_u_star": 1, "flux": -1, "repose_angle": 1},
)
