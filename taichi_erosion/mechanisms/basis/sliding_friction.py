"""Factor of the sliding friction of grains on each other.

    mu' = mu (1 + strength D)

with mu the sliding friction of grains on each other of the bare scene [1] and D the dose [1]: the factor
minus one. Strength multiplies the dose. Holds for doses above -1.

Reference: Di Renzo & Di Maio (2004), Chem. Eng. Sci. 59, 525 (Coulomb's limit in a contact).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Effect, Probe, quantity
from taichi_erosion.mechanisms.factors import factor_of, with_contact_factor
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene


@dataclass(frozen=True)
class Params:
    dose: float = quantity(1.0, "1", "factor minus one", low=-0.95, high=9.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with the changed contacts."""
    if strength * params.dose == 0.0:
        return scene
    factor = factor_of(strength, params.dose)
    return with_contact_factor(scene, "friction_sliding", factor, walls=False)


def checks(probe: Probe) -> Iterator[Check]:
    def number(pair: str, strength: float = 1.0) -> float:
        scene = probe(Params(dose=0.5), {}, scene=sample_scene(), strength=strength)
        return scene.contact[pair].friction_sliding

    yield Check("a dose of 0.5 is a factor of 1.5", number("sand-sand"), 0.75)
    yield Check("half the strength is half the dose", number("sand-sand", 0.5), 0.625)
    yield Check("other contacts stay", number("sand-steel"), 0.4)


EFFECT = Effect(
    name="sliding_friction",
    title="a factor of sliding friction",
    doc=__doc__,
    place="scene",
    params=Params,
    act=change,
    checks=checks,
)
