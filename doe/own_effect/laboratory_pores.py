"""Pores as the laboratory of doe/own_effect has them; docs/write_an_effect.md writes an effect of its own.

    rho_a = (1 - n) rho,    n = w V / (1 / rho + w V)

with rho the density of the solid [kg m-3], n the porosity of an aggregate [1], V the stated volume of pores
over the mass of solid [m3 kg-1], w the volume that counts over the stated one [1]. Strength multiplies w.
Holds for aggregates whose pores hold air.

Reference: Chepil (1950), Soil Sci. 70, 351 (apparent density of soil aggregates).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Conditions, Effect, Probe, quantity
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene, with_grain_material


@dataclass(frozen=True)
class Params:
    share: float = quantity(1.3, "1", "volume that counts over the stated one", low=0.1, high=5.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with porous aggregates for grains."""
    pores = strength * params.share * conditions.get("pore_volume", 0.0)
    if pores == 0.0:
        return scene

    def density(solid: float) -> float:
        return (1.0 - pores / (1.0 / solid + pores)) * solid

    return with_grain_material(scene, lambda m: m.model_copy(update={"density": density(m.density)}))


def checks(probe: Probe) -> Iterator[Check]:
    """Three statements about the law; the sample has a density of 2500 kg m-3."""

    def density(pores: float, strength: float = 1.0) -> float:
        changed = probe(Params(share=2.0), {"pore_volume": pores}, scene=sample_scene(), strength=strength)
        return changed.materials["sand"].density

    yield Check("as many pores as solid halve the density", density(2e-4), 1250.0)
    yield Check("half the strength is half the pores", density(4e-4, 0.5), 1250.0)
    yield Check("without pores nothing changes", density(0.0), 2500.0)


EFFECT = Effect(
    name="laboratory_pores",
    title="pores of the laboratory",
    doc=__doc__,
    place="scene",
    params=Params,
    act=change,
    checks=checks,
    reads=("pore_volume",),
)
