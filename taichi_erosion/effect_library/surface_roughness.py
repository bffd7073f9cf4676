"""Surface roughness: fixed stones among the sand take part of the wind's stress, large ones more.

    u*_sand = u* R,    R = ((1 - 2 m L) (1 + m b L))^(-1/2),    L = c / 2,    c = strength C
    b = C_s / C_0,    C_0 = (kappa / ln(h / z_0))^2,    z_0 = d / 30

with C the share of the ground that stones cover [1], h their height [m], all of them half spheres, whose
frontal area is half their base; C_s the force on a stone over rho u_h^2 times its frontal area [1], C_0 the
same of the sand, u_h being the wind at the height h, kappa = 0.4 and d the nominal diameter of the sand
[m]: a rough wall of grains has z_0 = d / 30. m is the share of the mean stress that counts for the windiest
spot [1]. So the shelter follows from the size of the stones, where vegetation needs a measured ratio
(drag_partition). The stress on the patch between the stones is that of u* R; thresholds and fluxes are
stated in u*. Where the conditions state a frontal area of obstacles over ground, L is that, times strength.
Holds for stones much larger than grains and c < 0.5; beyond, the wind skims over them.

Reference: Raupach, Gillette & Leys (1993), J. Geophys. Res. 98, 3023, eq. (14), C_s = 0.3; Nikuradse (1933),
VDI Forschungsheft 361 (z_0 = d / 30).
"""

from dataclasses import dataclass
from math import log

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity
from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import drag_partition, sample_scene, with_section
from taichi_erosion.scene.preparation.sizes import nominal_diameter

KARMAN = 0.4  # von Karman's constant [1]
GRAINS_PER_LENGTH = 30.0  # diameter over roughness length, Nikuradse (1933) [1]
FRONT = 0.5  # frontal area of a half sphere over its base [1]


@dataclass(frozen=True)
class Params:
    cover: float = quantity(0.04, "1", "share of the ground under stones", low=0.0, high=0.5)
    height: float = quantity(0.01, "m", "of the stones", low=1e-3, high=1.0)
    stone_drag: float = quantity(0.3, "1", "C_s, force on a stone over rho u_h^2 A", low=0.0, high=1.0)
    worst_spot: float = quantity(0.5, "1", "m, evenness of the stress", low=0.0, high=1.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene between stones; without wind as it is."""
    front = strength * conditions.get("roughness_density", FRONT * params.cover)
    if scene.wind is None or front == 0.0:
        return scene
    largest = nominal_diameter(scene.grains)
    if params.height <= largest:
        raise BadInput(f"effects.surface_roughness.height = {params.height:g} m: not above the {largest:g} m")
    sand_drag = (KARMAN / log(params.height * GRAINS_PER_LENGTH / largest)) ** 2
    share = drag_partition(front, 1.0 / FRONT, params.stone_drag / sand_drag, params.worst_spot)
    return with_section(scene, "wind", partition=scene.wind.partition * share)


def checks(probe: Probe) -> Checks:
    patch = {"length": 0.02, "width": 0.01, "height": 0.05}
    # 1 mm sand and stones of 0.1 m: ln(h / z_0) = ln 3000 = 8.00637, so C_0 = 0.002496 and b = 100.2
    stones = Params(cover=0.2, height=0.1, stone_drag=0.25, worst_spot=0.4)
    ratio = 0.25 / (0.4 / 8.0063676) ** 2

    def partition(strength: float = 1.0, **conditions: float) -> float:
        return probe(stones, conditions, scene=sample_scene(wind=patch), strength=strength).wind.partition

    yield Check("a fifth of the ground under stones", partition(), (0.92 * (1.0 + 0.04 * ratio)) ** -0.5)
    yield Check("at half the strength a tenth", partition(0.5), (0.96 * (1.0 + 0.02 * ratio)) ** -0.5)
    published = (0.84 * (1.0 + 0.08 * ratio)) ** -0.5
    yield Check("a frontal area that is stated counts", partition(roughness_density=0.2), published)
    yield Check("bare sand has all of the stress", partition(roughness_density=0.0), 1.0)


EFFECT = effect_of(
    __name__,
    "fixed stones that shelter the sand between them",
    "scene",
    change,
    reads=("roughness_density",),
    most=2.0,
    expected={"threshold_u_star": 1, "flux": -1},
)
