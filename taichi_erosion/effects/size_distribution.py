"""Size distribution: the spread of real grains in place of their median.

    masses lognormal:  D50 = the scene's diameter,  sigma = strength ln(q) / 1.2816,  q = d90 / d50
    numbers likewise:  median D50 exp(-3 sigma^2),  same sigma
    cut to  D50 exp(-c sigma) .. D50 exp(c sigma)

with D50 the mass median [m], q the spread [1], c the cut in standard deviations [1]; 1.2816 is the 90 %
point of the normal distribution. The number of grains changes so that their mass stays. Strength multiplies
sigma. A stated time step shrinks with the finest grain, and grains start farther apart by the factor of the
coarsest. Acts on scenes of one size. Holds for exp(2 c sigma) below 20, beyond which the neighbour search
drowns.

Reference: Folk & Ward (1957), J. Sediment. Petrol. 27, 3 (spread of sands); Hatch & Choate (1929), J.
Franklin Inst. 207, 369 (numbers from masses).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import exp, log
from typing import Any

from taichi_erosion.core.effect import Check, Conditions, Effect, Probe, quantity
from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import Scene
from taichi_erosion.scene.build.sizes import mean_cube
from taichi_erosion.scene.change import sample_scene, with_section, with_shorter_step, with_wider_fill
from taichi_erosion.scene.schema.grains import Lognormal, Monodisperse

NINETIETH = 1.2815516  # 90 % point of the standard normal distribution [1]


@dataclass(frozen=True)
class Params:
    spread: float = quantity(1.5, "1", "d90 over d50 by mass", low=1.0, high=3.0)
    cut: float = quantity(1.5, "1", "largest deviation of ln d, in standard deviations", low=0.5, high=3.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with sizes around its own."""
    size, sigma = scene.grains.size, strength * log(params.spread) / NINETIETH
    if sigma == 0.0:
        return scene
    if not isinstance(size, Monodisperse):
        raise BadInput("effects.size_distribution: grains.size has a distribution already")
    widest = exp(params.cut * sigma)
    median = max(size.diameter * exp(-3.0 * sigma**2), size.diameter / widest)
    sizes = Lognormal(
        law="lognormal",
        median=median,
        sigma_log=sigma,
        low=size.diameter / widest,
        high=size.diameter * widest,
    )
    count = max(1, round(scene.grains.count * size.diameter**3 / mean_cube(sizes)))
    spread = with_section(scene, "grains", size=sizes, count=count)
    return with_shorter_step(with_wider_fill(spread, widest), 1.0 / widest)


def checks(probe: Probe) -> Iterator[Check]:
    scene = with_section(sample_scene(), "grains", count=50000)

    def changed(strength: float = 1.0) -> Any:
        return probe(Params(spread=1.4, cut=2.0), {}, scene=scene, strength=strength)

    sigma = log(1.4) / 1.2815516
    size = changed().grains.size
    yield Check("d90 / d50 gives the width of ln d", size.sigma_log, sigma)
    yield Check("strength multiplies it", changed(0.5).grains.size.sigma_log, 0.5 * sigma)
    yield Check("the mass median stays, numbers lie lower", size.median, 1e-3 * exp(-3 * sigma**2))
    yield Check("the coarsest grains are two deviations up", size.high, 1e-3 * exp(2.0 * sigma))
    yield Check("the finest two deviations down", size.low, 1e-3 * exp(-2.0 * sigma))
    volume = changed().grains.count * mean_cube(size)
    yield Check("the mass of all grains stays", volume, 50000 * 1e-9, rtol=1e-4)
    yield Check("the time step shrinks with the finest", changed().run.time_step, 1e-6 * exp(-2.0 * sigma))


EFFECT = Effect(
    name="size_distribution",
    title="lognormal grain sizes in place of the median",
    doc=__doc__,
    place="scene",
    params=Params,
    act=change,
    checks=checks,
    most=2.0,
)
