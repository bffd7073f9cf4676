"""Factor of the stiffness of grains.

    E' = E (1 + strength D)

with E the elastic modulus of the bare scene [Pa] and D the dose [1]: the factor minus one. A stated time step
shortens with the duration of a contact. Strength multiplies the dose. Holds for doses above -1.

Reference: Hertz (1882), J. reine angew. Math. 92, 156 (force of an elastic contact).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Effect, Probe, quantity
from taichi_erosion.mechanisms.factors import factor_of
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene, with_grain_material, with_shorter_step
from taichi_erosion.scene.schema.grains import Material


@dataclass(frozen=True)
class Params:
    dose: float = quantity(1.0, "1", "factor minus one", low=-0.95, high=99.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with stiffer or softer grains."""
    if strength * params.dose == 0.0:
        return scene
    factor = factor_of(strength, params.dose)

    def stiffer(material: Material) -> Material:
        name = "young_modulus" if material.young_modulus is not None else "shear_modulus"
        return material.model_copy(update={name: factor * getattr(material, name)})

    return with_shorter_step(with_grain_material(scene, stiffer), factor**-0.5)


def checks(probe: Probe) -> Iterator[Check]:
    def changed(strength: float = 1.0) -> Scene:
        return probe(Params(dose=3.0), {}, scene=sample_scene(), strength=strength)

    materials = changed().materials
    half = changed(0.5).materials["sand"].young_modulus or 0.0
    yield Check("a dose of 3 is a factor of 4", materials["sand"].young_modulus or 0.0, 4e7)
    yield Check("half the strength is half the dose", half, 2.5e7)
    yield Check("walls keep their stiffness", materials["steel"].young_modulus or 0.0, 1e7)
    yield Check("the time step shortens", changed().run.time_step or 0.0, 5e-7)


EFFECT = Effect(
    name="stiffness",
    title="a factor of stiffness",
    doc=__doc__,
    place="scene",
    params=Params,
    act=change,
    checks=checks,
)
