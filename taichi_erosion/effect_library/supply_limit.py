"""Supply limit: a thin cover of loose grains on a hard floor.

    N = N_0 (N_c / N_0)^strength,    N_c = c A / d^2

with N_0 the number of grains of the scene, c the cover, grains per square of the diameter [1] (1 is a full
square layer), A the area of the patch [m2] and d the nominal diameter [m]. The depth of the bed does not
count: a cover of a tenth of a layer is one under any scene. Over a hard floor few grains hop high and
fast, and the flux can be larger than over a loose bed. A floor of the scene is smooth, that of a stony
desert is not. The sign of the change of flux depends on cover and wind, and none is claimed. Strength
multiplies ln(N_c / N_0). Acts on scenes with wind. Holds for covers of less than a few layers.

Reference: Nickling & McKenna Neuman (2009), in Geomorphology of Desert Environments, 2nd ed., ch. 17
(supply and transport limits); Ho, Valance, Dupont & Ould El Moctar (2011), Phys. Rev. Lett. 106, 094501
(flux over a rigid bed).
"""

from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene, with_section
from taichi_erosion.scene.preparation.sizes import nominal_diameter


@dataclass(frozen=True)
class Params:
    cover: float = quantity(0.1, "1", "loose grains per square of the diameter", low=1e-3, high=10.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with a thin cover of grains."""
    wind, before = scene.wind, scene.grains.count
    if wind is None or strength == 0.0:
        return scene
    covered = params.cover * wind.length * wind.width / nominal_diameter(scene.grains) ** 2
    return with_section(scene, "grains", count=max(1, round(before * (covered / before) ** strength)))


def checks(probe: Probe) -> Checks:
    patch = {"length": 0.04, "width": 0.025, "height": 0.05}  # 1000 squares of 1 mm

    def grain_count(strength: float) -> int:
        scene = sample_scene(grains={"count": 6400}, wind=patch)
        return probe(Params(cover=0.4), {}, scene=scene, strength=strength).grains.count

    yield Check("a cover of 0.4 on 1000 squares is 400 grains", grain_count(1.0), 400)
    yield Check("at half the strength the mean of the logarithms", grain_count(0.5), 1600)
    yield Check("at strength 1.5 a quarter of the cover", grain_count(1.5), 100)


EFFECT = effect_of(__name__, "thin cover of loose grains on a hard floor", "scene", change, most=1.5)
