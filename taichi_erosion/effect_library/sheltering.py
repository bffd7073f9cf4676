"""Sheltering: a coarse lag among the sand, which the wind does not move.

    share s = strength S of the mass has the diameter n D, the rest D

with D the scene's diameter [m], n the ratio of coarse to fine [1], S the share of the mass that is coarse
[1]. Coarse grains are n^3 times as heavy as fine ones and stay where winds near the threshold of the fine
ones blow; they take part of the stress and hide fine grains behind them. The number of grains changes so
that their mass stays. Strength multiplies the share. Sizes scatter by 2 % around both values; grains start
farther apart by the factor n. Acts on scenes of one size. Holds for strength S < 1 and winds below the
threshold of the lag.

Reference: Egiazaroff (1965), J. Hydraul. Div. 91, 225 (hiding); Nickling & McKenna Neuman (1995),
Sedimentology 42, 247 (lag surfaces in a tunnel).
"""

from dataclasses import dataclass
from typing import Any

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity
from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene, with_section, with_wider_fill
from taichi_erosion.scene.preparation.sizes import mean_cubed_diameter
from taichi_erosion.scene.schema.grains import Monodisperse, Sieve

SCATTER = 0.02  # half width of each of the two classes over its diameter [1]


@dataclass(frozen=True)
class Params:
    share: float = quantity(0.17, "1", "coarse share of the mass", low=0.0, high=0.3)
    ratio: float = quantity(3.0, "1", "coarse over fine diameter", low=1.5, high=10.0)


def single_size_row(diameter: float, mass: float) -> tuple[float, float, float]:
    """Row of a sieve table for grains of nearly one size."""
    return ((1.0 - SCATTER) * diameter, (1.0 + SCATTER) * diameter, mass)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with a coarse lag."""
    size = scene.grains.size
    share = strength * params.share
    if share == 0.0:
        return scene
    if not isinstance(size, Monodisperse):
        raise BadInput("effects.sheltering: grains.size has a distribution already")
    if share >= 1.0:
        raise BadInput(f"effects.sheltering: strength times share = {share:g} must stay below 1")
    rows = (single_size_row(size.diameter, 1.0 - share), single_size_row(params.ratio * size.diameter, share))
    mixed = Sieve(law="sieve", rows=rows, table=None)
    count = max(1, round(scene.grains.count * size.diameter**3 / mean_cubed_diameter(mixed)))
    lagged = with_section(scene, "grains", size=mixed, count=count)
    mean = mean_cubed_diameter(mixed) ** (1.0 / 3.0) / size.diameter
    return with_wider_fill(lagged, (1.0 + SCATTER) * params.ratio, mean)


def checks(probe: Probe) -> Checks:
    scene = with_section(sample_scene(), "grains", count=50000)

    def changed_scene(strength: float = 1.0) -> Any:
        return probe(Params(share=0.2, ratio=2.5), {}, scene=scene, strength=strength)

    fine, coarse = changed_scene().grains.size.rows
    yield Check("the lag is 2.5 times as coarse", 0.5 * (coarse[0] + coarse[1]), 2.5e-3)
    yield Check("and a fifth of the mass", coarse[2], 0.2)
    yield Check("the sand keeps its size", 0.5 * (fine[0] + fine[1]), 1e-3)
    yield Check("strength multiplies the share", changed_scene(0.5).grains.size.rows[1][2], 0.1)
    # fine grains: 0.8 of the mass as before; coarse ones: 0.2 in grains 15.625 times as heavy
    numbers = 50000 * (0.8 + 0.2 / 2.5**3)
    yield Check("fewer grains hold the mass", changed_scene().grains.count, numbers, rtol=5e-3)


EFFECT = effect_of(
    __name__, "coarse lag that shelters sand", "scene", change, expected={"threshold_u_star": 1, "flux": -1}
)
