"""Drag partition: stones and plants take part of the wind's stress from the ground between them.

    u*_ground = u* R,    R = ((1 - m s L) (1 + m b L))^(-1/2),    L = strength lambda

with lambda the frontal area of the obstacles over the area of the ground [1], from the conditions or the
parameter where they state none, s their basal over their frontal area [1], b the drag coefficient of an
obstacle over that of the ground [1], m the share of the mean stress that counts for the worst spot [1]. The
stress on the patch between the obstacles is that of u* R; thresholds and fluxes are stated in u*. Strength
multiplies lambda. Holds for m s L < 1 and L < 0.5, obstacles much taller than grains.

Reference: Raupach, Gillette & Leys (1993), J. Geophys. Res. 98, 3023, eq. (14).
"""

from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import drag_partition, sample_scene, with_section


@dataclass(frozen=True)
class Params:
    roughness_density: float = quantity(
        0.02, "1", "lambda where the conditions state none", low=0.0, high=0.5
    )
    drag_ratio: float = quantity(
        100.0, "1", "b, drag of an obstacle over that of the ground", low=0.0, high=500.0
    )
    basal_ratio: float = quantity(1.0, "1", "s, basal over frontal area", low=0.0, high=5.0)
    worst_spot: float = quantity(0.5, "1", "m, evenness of the stress", low=0.0, high=1.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene between obstacles; without wind as it is."""
    density = strength * conditions.get("roughness_density", params.roughness_density)
    if scene.wind is None or density == 0.0:
        return scene
    share = drag_partition(density, params.basal_ratio, params.drag_ratio, params.worst_spot)
    return with_section(scene, "wind", partition=scene.wind.partition * share)


def checks(probe: Probe) -> Checks:
    patch = {"length": 0.02, "width": 0.01, "height": 0.05}
    plants = Params(roughness_density=0.1, drag_ratio=80.0, basal_ratio=2.0, worst_spot=0.4)

    def partition(strength: float = 1.0, **conditions: float) -> float:
        return probe(plants, conditions, scene=sample_scene(wind=patch), strength=strength).wind.partition

    yield Check("Raupach's ratio", partition(), (0.92 * 4.2) ** -0.5)
    yield Check("half the strength is half the density", partition(0.5), (0.96 * 2.6) ** -0.5)
    published = partition(roughness_density=0.2)
    yield Check("the density of the conditions counts", published, (0.84 * 7.4) ** -0.5)
    yield Check("bare ground has all of the stress", partition(roughness_density=0.0), 1.0)


EFFECT = effect_of(
    __name__,
    "roughness and vegetation that shelter the ground (Raupach)",
    "scene",
    change,
    reads=("roughness_density",),
    expected={"threshold_u_star": 1, "flux": -1},
)
