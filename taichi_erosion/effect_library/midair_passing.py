"""Mid-air passing: grains that meet in the air pass through each other, as most models of saltation let them.

    two grains pass where both centres are higher than  h = z_b + n d  above the floor when they meet

with z_b the height of the undisturbed bed [m], d the nominal diameter [m] and n the height in diameters over
which grains count as airborne [1]. The bare model collides all grains everywhere; with this effect it
becomes the model without mid-air collisions, so that the two can be compared. Strength is the share of the
pairs that pass: each pair of grains always collides or always passes. Two that are already inside each other
by more than a quarter of their effective radius go on passing when they sink into the bed, and two that
touch go on touching when they rise out of it. Holds for scenes under wind; elsewhere there is no bed.

Reference: Carneiro, Araujo, Pahtz & Herrmann (2013), Phys. Rev. Lett. 111, 058001 (midair collisions raise
the flux); Sorensen & McEwan (1996), Sedimentology 43, 65 (how often grains collide).
"""

from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Checks, Conditions, Constants, Probe, effect_of, quantity
from taichi_erosion.core.ti import ti

DEEP = 0.25  # overlap over the effective radius that no first touch reaches in one step [1]


@dataclass(frozen=True)
class Params:
    height: float = quantity(3.0, "1", "height above the bed, in diameters", low=0.0, high=1000.0)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica; without a bed no pair passes."""
    share = strength if "bed_height" in conditions else 0.0
    above = params.height * conditions.get("grain_diameter", 0.0)
    return {"share": share, "height": conditions.get("bed_height", 0.0) + above}


@ti.func
def passes(constants, contact):
    """1 where two grains pass through each other."""
    airborne = contact.height > constants.height or contact.depth > DEEP
    return ti.select(contact.chance < constants.share and airborne, 1.0, 0.0)


def checks(probe: Probe) -> Checks:
    bed = {"bed_height": 2e-3, "grain_diameter": 2e-4}

    def free_passage(height: float, chance: float = 0.5, depth: float = 0.01, **options: float) -> float:
        return probe(Params(height=5.0), bed, height=height, chance=chance, depth=depth, **options)

    yield Check("grains above 2 mm + 5 d pass", free_passage(3.05e-3), 1.0)
    yield Check("grains below collide", free_passage(2.95e-3), 0.0)
    yield Check("just above they pass", free_passage(3.01e-3), 1.0)
    yield Check("at strength 0.6 pairs of a chance below pass", free_passage(4e-3, 0.59, strength=0.6), 1.0)
    yield Check("and the others collide", free_passage(4e-3, 0.61, strength=0.6), 0.0)
    yield Check("two inside each other do not explode in the bed", free_passage(1e-3, depth=0.3), 1.0)


EFFECT = effect_of(
    __name__, "no collisions of grains in the air", "first_contact", passes, most=1.0, expected={"flux": -1}
)
