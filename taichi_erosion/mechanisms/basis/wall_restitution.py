"""Factor of the restitution of grains on walls.

    e' = e (1 + strength D), at most 1

with e the restitution of grains on walls of the bare scene [1] and D the dose [1]: the factor minus one.
Strength multiplies the dose. Holds for doses above -1.

Reference: Tsuji, Tanaka & Ishida (1992), Powder Technology 71, 239 (damping from restitution).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Effect, Probe, quantity
from taichi_erosion.mechanisms.factors import factor_of, with_contact_factor
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene


@dataclass(frozen=True)
class Params:
    dose: float = quantity(1.0, "1", "factor minus one", low=-0.95, high=4.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with the changed contacts."""
    if strength * params.dose == 0.0:
        return scene
    factor = factor_of(strength, params.dose)
    return with_contact_factor(scene, "restitution", factor, walls=True, most=1.0)


def checks(probe: Probe) -> Iterator[Check]:
    def number(pair: str, strength: float = 1.0) -> float:
        scene = probe(Params(dose=0.5), {}, scene=sample_scene(), strength=strength)
        return scene.contact[pair].restitution

    yield Check("a dose of 0.5 is a factor of 1.5", number("sand-steel"), 0.75)
    yield Check("half the strength is half the dose", number("sand-steel", 0.5), 0.625)
    yield Check("other contacts stay", number("sand-sand"), 0.6)
    yield Check("a restitution of 1 is the largest", number("sand-steel", 40.0), 1.0)


EFFECT = Effect(
    name="wall_restitution",
    title="a factor of restitution on walls",
    doc=__doc__,
    place="scene",
    params=Params,
    act=change,
    checks=checks,
)
