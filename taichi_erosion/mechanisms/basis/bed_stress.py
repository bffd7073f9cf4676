"""Factor of the wind's stress that reaches the bed.

    u*' = u* sqrt(1 + strength D)

with u* the friction velocity of the patch [m s-1] and D the dose [1]: the factor of the stress minus one.
Strength multiplies the dose. Holds for doses above -1; a scene without wind stays as it is.

Reference: Raupach (1992), Boundary-Layer Meteorol. 60, 375 (partition of the stress).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Effect, Probe, quantity
from taichi_erosion.mechanisms.factors import factor_of
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene, with_section


@dataclass(frozen=True)
class Params:
    dose: float = quantity(-0.2, "1", "factor of the stress minus one", low=-0.95, high=3.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with more or less stress on its patch."""
    if scene.wind is None or strength * params.dose == 0.0:
        return scene
    share = factor_of(strength, params.dose) ** 0.5
    return with_section(scene, "wind", partition=scene.wind.partition * share)


def checks(probe: Probe) -> Iterator[Check]:
    patch = {"length": 0.02, "width": 0.01, "height": 0.05, "partition": 0.5}

    def partition(dose: float, strength: float = 1.0) -> float:
        return probe(Params(dose=dose), {}, scene=sample_scene(wind=patch), strength=strength).wind.partition

    still = sample_scene()
    yield Check("a dose of -0.36 leaves 0.8 of u*", partition(-0.36), 0.4)
    yield Check("half the strength is half the dose", partition(-0.72, 0.5), 0.4)
    yield Check("a dose of 0.44 is 1.2 times u*", partition(0.44), 0.6)
    yield Check("without wind nothing changes", float(probe(Params(), {}, scene=still) == still), 1.0)


EFFECT = Effect(
    name="bed_stress",
    title="a factor of the stress at the bed",
    doc=__doc__,
    place="scene",
    params=Params,
    act=change,
    checks=checks,
)
