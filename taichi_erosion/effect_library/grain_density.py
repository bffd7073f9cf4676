"""Grain density: what the grains weigh in truth, in place of what the scene assumes.

    rho = rho_0 + strength (rho_s (1 - n) - rho_0)

with rho_0 the density of the scene [kg m-3], rho_s that of the solid [kg m-3] and n the share of a grain's
volume that is closed pores [1]. Thresholds go with the square root of the density. Strength is linear in
the density: 1 is the true one. Materials keep their stiffness; a stated time step shrinks with sqrt(rho)
where grains become lighter. Holds for grains, not for the soil with the voids between them.

Reference: Lide (2004), CRC Handbook of Chemistry and Physics, 85th ed., sec. 4 (quartz, 2650 kg m-3);
Bagnold (1941), The Physics of Blown Sand, ch. 7 (threshold and density).
"""

from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity
from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene, with_grain_material, with_shorter_step


@dataclass(frozen=True)
class Params:
    solid_density: float = quantity(2650.0, "kg m-3", "of the solid", low=200.0, high=8000.0)
    porosity: float = quantity(0.0, "1", "share of closed pores in a grain", low=0.0, high=0.8)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with heavier or lighter grains."""
    solid = params.solid_density * (1.0 - params.porosity)
    density = {name: m.density + strength * (solid - m.density) for name, m in scene.grain_materials.items()}
    if (least := min(density.values())) <= 0.0:
        raise BadInput(f"effects.grain_density: strength = {strength:g} gives {least:g} kg m-3")
    ratios = (density[name] / m.density for name, m in scene.grain_materials.items())
    changed = with_grain_material(
        scene, lambda m: m.model_copy(update={"density": m.density + strength * (solid - m.density)})
    )
    return with_shorter_step(changed, min(ratios) ** 0.5)


def checks(probe: Probe) -> Checks:
    porous = Params(solid_density=3000.0, porosity=0.4)  # 1800 kg/m3 in place of 2500

    def changed_scene(strength: float) -> Scene:
        return probe(porous, {}, scene=sample_scene(), strength=strength)

    def density(strength: float) -> float:
        return changed_scene(strength).materials["sand"].density

    step = changed_scene(1.0).run.time_step
    yield Check("pores take their share of the weight", density(1.0), 1800.0)
    yield Check("half the strength goes half the way", density(0.5), 2150.0)
    yield Check("lighter grains need a shorter step", step or 0.0, 1e-6 * 0.72**0.5)
    yield Check("walls keep their density", changed_scene(1.0).materials["steel"].density, 7850.0)


EFFECT = effect_of(__name__, "true density of the grains", "scene", change, most=1.5)
