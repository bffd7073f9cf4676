"""Grain shape: elongated grains in place of spheres, as rigid pairs of overlapping spheres.

    length / width = 1 + e,    e = strength E
    centres at +- e r along the axis, both of radius r = (d/2) (1 + (3/2) e - (1/2) e^3)^(-1/3)

with E the elongation of the soil [1] and d the diameter of the sphere of equal volume [m], which is that of
the scene. e = 0 is the sphere, e = 1 two spheres that touch. Grains that roll over each other must lift
themselves over their long axis: shape resolves what rolling resistance stands for. Strength multiplies the
elongation. Grains start farther apart by the factor of their reach, and a stated time step shrinks with r.
Holds for convex grains, e well below 1, and for e <= 1 at all.

Reference: Cho, Dodds & Santamarina (2006), J. Geotech. Geoenviron. Eng. 132, 591 (sphericity of sands, 0.7
to 0.9: width over length); Favier et al. (1999), Eng. Comput. 16, 467 (multi-sphere grains).
"""

from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity
from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene, with_section, with_shorter_step, with_wider_fill
from taichi_erosion.scene.schema.grains import Clump, ClumpSphere


@dataclass(frozen=True)
class Params:
    elongation: float = quantity(0.3, "1", "length over width of a grain, less 1", low=0.0, high=1.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with elongated grains."""
    elongation = strength * params.elongation
    if elongation == 0.0:
        return scene
    if elongation > 1.0:
        raise BadInput(f"effects.grain_shape: strength times elongation = {elongation:g} lies outside [0, 1]")
    if scene.wind is not None:
        raise BadInput("effects.grain_shape: under wind drag acts on single spheres")
    if scene.grains.clump is not None:
        raise BadInput("effects.grain_shape: grains.clump gives the grains a shape already")
    radius = 0.5 * (1.0 + 1.5 * elongation - 0.5 * elongation**3) ** (-1.0 / 3.0)
    ends = (-elongation * radius, elongation * radius)
    spheres = tuple(ClumpSphere(offset=(x, 0.0, 0.0), radius=radius) for x in ends)
    longer = with_section(scene, "grains", clump=Clump(template=None, spheres=spheres))
    return with_shorter_step(with_wider_fill(longer, 2.0 * radius * (1.0 + elongation)), 2.0 * radius)


def checks(probe: Probe) -> Checks:
    scene = sample_scene()

    def spheres(elongation: float, strength: float) -> tuple[ClumpSphere, ...]:
        changed = probe(Params(elongation), {}, scene=scene, strength=strength)
        return changed.grains.clump.spheres if changed.grains.clump else ()

    first, second = spheres(0.4, 0.5)
    length = second.offset[0] - first.offset[0] + 2.0 * second.radius
    yield Check("half of an elongation of 0.4 is acted on", length / (2.0 * first.radius), 1.2)
    touching = spheres(0.5, 2.0)[0].radius
    yield Check("two touching spheres have half the volume each", (2.0 * touching) ** 3, 0.5)
    lens = 1.0 - 1.5 * 0.2 + 0.5 * 0.2**3  # that two spheres share, over a sphere
    yield Check("two overlapping ones fill one sphere", (2.0 - lens) * (2.0 * first.radius) ** 3, 1.0)
    wider = probe(Params(0.4), {}, scene=scene, strength=0.5)
    pitch = 1.2e-3 * 2.0 * first.radius * 1.2
    yield Check("grains start as much farther apart as they reach", wider.fill.pitch, pitch)
    step = wider.run.time_step or 0.0
    yield Check("the time step shrinks with the spheres", step, 2e-6 * first.radius)


EFFECT = effect_of(
    __name__, "elongated grains as pairs of spheres", "scene", change, most=2.0, expected={"repose_angle": 1}
)
