"""Factor of the rolling friction of grains on walls.

    mu_r' = mu_r (1 + strength D),    mu_r' = m strength D where mu_r = 0

with mu_r the rolling friction of the bare scene [1], D the dose [1]: the factor minus one, and m the rolling
friction that counts as 1 where the bare scene has none [1]; grains then get the elastic-plastic law. Strength
multiplies the dose. Holds for doses above -1; from nothing for those above 0.

Reference: Ai, Chen, Rotter & Ooi (2011), Powder Technology 206, 269 (rolling friction).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Effect, Probe, quantity
from taichi_erosion.mechanisms.factors import with_rolling_factor
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene


@dataclass(frozen=True)
class Params:
    dose: float = quantity(1.0, "1", "factor minus one", low=-0.95, high=19.0)
    reference: float = quantity(0.1, "1", "rolling friction that a dose of 1 adds to none", low=0.0, high=1.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with the changed contacts; the law of rolling comes with it where the scene has none."""
    return with_rolling_factor(scene, strength, params.dose, params.reference, walls=True)


def checks(probe: Probe) -> Iterator[Check]:
    bare, rolling = sample_scene(), sample_scene(laws={"rolling": "constant_torque"})

    def number(pair: str, scene: Scene, strength: float = 1.0) -> float:
        changed = probe(Params(dose=0.5, reference=0.2), {}, scene=scene, strength=strength)
        return changed.contact[pair].friction_rolling

    law = probe(Params(), {}, scene=bare).laws.rolling
    yield Check("a dose of 0.5 is a factor of 1.5", number("sand-steel", rolling), 0.3)
    yield Check("half the strength is half the dose", number("sand-steel", rolling, 0.5), 0.25)
    yield Check("other contacts stay", number("sand-sand", rolling), 0.1)
    yield Check("a scene without rolling friction gets the reference", number("sand-steel", bare), 0.1)
    yield Check("with the law of type C", float(law == "elastic_plastic"), 1.0)
    yield Check("its other contacts still roll freely", number("sand-sand", bare), 0.0)


EFFECT = Effect(
    name="wall_rolling_friction",
    title="a factor of rolling friction on walls",
    doc=__doc__,
    place="scene",
    params=Params,
    act=change,
    checks=checks,
)
