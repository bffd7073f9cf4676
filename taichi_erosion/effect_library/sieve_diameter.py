"""Sieve diameter: grains that pass a mesh are not spheres of its width.

    d = d_s (1 + strength (k - 1))

with d_s the diameter by sieving that the scene states [m], k the diameter of the sphere of equal volume
over it [1]. A grain passes a square mesh by its middle axis; round sand has k near 1, elongated grains up
to 1.3, flat ones down to 0.8. It is an error of the instrument, acts on the sizes of the scene, and is
shared by all measurements of one laboratory. Strength is linear in d. Lengths of the apparatus stay; a
stated time step shrinks where grains become smaller. Holds for one mesh; a curve is shifted as a whole.

Reference: Fernlund (1998), Eng. Geol. 50, 279 (shape and sieving); ISO 9276-6 (2008) (diameters of equal
volume).
"""

from dataclasses import dataclass
from typing import Any

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene, with_section, with_shorter_step, with_wider_fill
from taichi_erosion.scene.schema.grains import Size


@dataclass(frozen=True)
class Params:
    ratio: float = quantity(1.1, "1", "diameter of equal volume over that of the mesh", low=0.7, high=1.5)


def scale_diameters(size: Size, factor: float) -> Size:
    """All diameters of a size law multiplied."""
    if size.law == "sieve":
        return size.model_copy(update={"scale": size.scale * factor})
    lengths = ("diameter",) if size.law == "monodisperse" else ("median", "low", "high")
    grown: dict[str, Any] = {name: getattr(size, name) * factor for name in lengths}
    return size.model_copy(update=grown)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with grains of their true size."""
    factor = 1.0 + strength * (params.ratio - 1.0)
    if factor == 1.0:
        return scene
    size, kinds = scene.grains.size, scene.grains.kinds
    grown = {k: v.model_copy(update={"size": scale_diameters(v.size, factor)}) for k, v in kinds.items()}
    resized = with_section(scene, "grains", size=size and scale_diameters(size, factor), kinds=grown)
    return with_shorter_step(with_wider_fill(resized, factor), factor)


def checks(probe: Probe) -> Checks:
    spread = {"law": "lognormal", "median": 1e-3, "sigma_log": 0.1, "low": 8e-4, "high": 1.05e-3}
    table = {"law": "sieve", "rows": [[9e-4, 1.05e-3, 1.0]]}

    def size(strength: float = 1.0, **grains: Any) -> Any:
        return probe(Params(1.2), {}, scene=sample_scene(grains=grains), strength=strength).grains.size

    yield Check("a grain is 1.2 times its mesh", size().diameter, 1.2e-3)
    yield Check("half the strength goes half the way", size(0.5).diameter, 1.1e-3)
    yield Check("a lognormal law grows as a whole", size(size=spread).median, 1.2e-3)
    yield Check("with its ends", size(size=spread).high, 1.26e-3)
    yield Check("a sieve curve is magnified", size(size=table).scale, 1.2)


EFFECT = effect_of(
    __name__, "sieve against true diameter (instrument)", "scene", change, prior_scale=0.5, most=2.0
)
