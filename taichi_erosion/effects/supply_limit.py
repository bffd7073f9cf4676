"""Supply limit: only part of the bed is loose.

    N = N_0 (1 - s),    s = strength S

with N_0 the number of grains of the scene and S the share of them that is not there to be moved [1],
because a crust, stones or a fixed floor lie where they were. The floor of the scene comes nearer to the
surface; where loose grains cover it in less than a layer, the flux starves. Strength multiplies S. Holds
for strength S < 1.

Reference: Nickling & McKenna Neuman (2009), in Geomorphology of Desert Environments, 2nd ed., ch. 17
(supply and transport limits); Gillette, Herbert, Stockton & Owen (1996), Earth Surf. Process. Landforms 21,
641.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Effect, Probe, quantity
from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene, with_section


@dataclass(frozen=True)
class Params:
    missing: float = quantity(0.3, "1", "share of the grains that is not loose", low=0.0, high=0.99)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with fewer grains."""
    missing = strength * params.missing
    if missing >= 1.0:
        raise BadInput(f"effects.supply_limit: strength times missing = {missing:g} must stay below 1")
    return with_section(scene, "grains", count=max(1, round(scene.grains.count * (1.0 - missing))))


def checks(probe: Probe) -> Iterator[Check]:
    def count(strength: float) -> int:
        scene = sample_scene(grains={"count": 1000})
        return probe(Params(missing=0.4), {}, scene=scene, strength=strength).grains.count

    yield Check("two fifths of the grains are not there", count(1.0), 600)
    yield Check("at half the strength one fifth", count(0.5), 800)
    yield Check("at twice the strength four fifths", count(2.0), 200)


EFFECT = Effect(
    name="supply_limit",
    title="limited supply of loose grains",
    doc=__doc__,
    place="scene",
    params=Params,
    act=change,
    checks=checks,
    expected={"flux": -1},
)
