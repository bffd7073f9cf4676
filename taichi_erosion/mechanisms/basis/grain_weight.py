"""Factor of the weight and the inertia of grains.

    rho' = rho (1 + strength D)

with rho the density of the grains of the bare scene [kg m-3] and D the dose [1]: the factor minus one. A
stated time step shortens for lighter grains. Strength multiplies the dose. Holds for doses above -1.

Reference: Bagnold (1941), The physics of blown sand and desert dunes (weight in the threshold).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Effect, Probe, quantity
from taichi_erosion.mechanisms.factors import factor_of
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene, with_grain_material, with_shorter_step


@dataclass(frozen=True)
class Params:
    dose: float = quantity(0.5, "1", "factor minus one", low=-0.95, high=9.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with heavier or lighter grains."""
    if strength * params.dose == 0.0:
        return scene
    factor = factor_of(strength, params.dose)
    changed = with_grain_material(
        scene, lambda material: material.model_copy(update={"density": factor * material.density})
    )
    return with_shorter_step(changed, factor**0.5)


def checks(probe: Probe) -> Iterator[Check]:
    def changed(strength: float = 1.0) -> Scene:
        return probe(Params(dose=-0.5), {}, scene=sample_scene(), strength=strength)

    yield Check("a dose of -0.5 is half the weight", changed().materials["sand"].density, 1250.0)
    yield Check("half the strength is half the dose", changed(0.5).materials["sand"].density, 1875.0)
    yield Check("walls keep their density", changed().materials["steel"].density, 7850.0)
    yield Check("lighter grains need a shorter step", changed().run.time_step or 0.0, 1e-6 * 0.5**0.5)


EFFECT = Effect(
    name="grain_weight",
    title="a factor of the weight of grains",
    doc=__doc__,
    place="scene",
    params=Params,
    act=change,
    checks=checks,
)
