"""Size distribution: the spread of real grains in place of their median.

    masses lognormal:  D50 = the scene's diameter,  sigma = strength ln(q) / z,  q = d90 / d50
    cut to  D50 exp(-c sigma) .. D50 exp(c sigma)
    z the 90 % point of the cut distribution,  Phi(z) = Phi(-c) + 0.9 (Phi(c) - Phi(-c))

with D50 the mass median [m], q the spread [1], c the cut in standard deviations [1], Phi the normal
distribution. The masses are those of CLASSES sieves, equal in ln d. The number of grains changes so that
their mass stays. Strength multiplies sigma. A stated time step shrinks with the finest grain. Acts on scenes
of one size. Holds for exp(2 c sigma) below 20, beyond which the neighbour search costs more than contacts.

Reference: Folk & Ward (1957), J. Sediment. Petrol. 27, 3 (spread of sands).
"""

from dataclasses import dataclass
from math import exp, log
from statistics import NormalDist
from typing import Any

import numpy as np

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity
from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene, with_section, with_shorter_step, with_wider_fill
from taichi_erosion.scene.preparation.sizes import mean_cubed_diameter
from taichi_erosion.scene.schema.grains import Monodisperse, Sieve

CLASSES = 50  # sieves; d90 over d50 is then right to 2e-4 for cuts up to 2, to 1e-3 beyond [1]
NORMAL = NormalDist()


@dataclass(frozen=True)
class Params:
    spread: float = quantity(1.5, "1", "d90 over d50 by mass", low=1.0, high=3.0)
    cut: float = quantity(1.5, "1", "largest deviation of ln d, in standard deviations", low=0.5, high=3.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with sizes around its own."""
    below = NORMAL.cdf(-params.cut)
    ninetieth = NORMAL.inv_cdf(below + 0.9 * (1.0 - 2.0 * below))  # percentile of the cut normal distribution
    size = scene.grains.size
    sigma = strength * log(params.spread) / ninetieth
    if sigma == 0.0:
        return scene
    if not isinstance(size, Monodisperse):
        raise BadInput("effects.size_distribution: grains.size has a distribution already")
    deviates = np.linspace(-params.cut, params.cut, CLASSES + 1)
    shares = np.diff([NORMAL.cdf(deviate) for deviate in deviates])
    edges = size.diameter * np.exp(sigma * deviates)
    rows = tuple((float(a), float(b), float(w)) for a, b, w in zip(edges, edges[1:], shares, strict=False))
    widest, sizes = exp(params.cut * sigma), Sieve(law="sieve", rows=rows, table=None)
    count = max(1, round(scene.grains.count * size.diameter**3 / mean_cubed_diameter(sizes)))
    mean = mean_cubed_diameter(sizes) ** (1.0 / 3.0) / size.diameter
    spread = with_section(scene, "grains", size=sizes, count=count)
    return with_shorter_step(with_wider_fill(spread, widest, mean), 1.0 / widest)


def checks(probe: Probe) -> Checks:
    scene = with_section(sample_scene(), "grains", count=50000)

    def changed_scene(strength: float = 1.0) -> Any:
        return probe(Params(spread=1.4, cut=2.0), {}, scene=scene, strength=strength)

    def passing(mass: float, size: Any) -> float:
        below = np.cumsum([0.0, *(row[2] for row in size.rows)])
        edges = [size.rows[0][0], *(row[1] for row in size.rows)]
        return exp(np.interp(mass * below[-1], below, np.log(edges)))

    size = changed_scene().grains.size
    sigma = log(1.4) / 1.184032  # Phi(1.184032) = 0.0227501 + 0.9 0.9544997
    spread, half = passing(0.9, size) / passing(0.5, size), passing(0.9, changed_scene(0.5).grains.size)
    yield Check("d90 over d50 of the masses is as asked", spread, 1.4, rtol=3e-4)
    yield Check("strength multiplies its logarithm", half, 1e-3 * 1.4**0.5, rtol=3e-4)
    yield Check("the mass median stays", passing(0.5, size), 1e-3)
    finest, coarsest = exp(-2.0 * sigma), exp(2.0 * sigma)  # over the median [1]
    yield Check("the coarsest grains are two deviations up", size.rows[-1][1], 1e-3 * coarsest, rtol=1e-4)
    yield Check("the finest two deviations down", size.rows[0][0], 1e-3 * finest, rtol=1e-4)
    volume = changed_scene().grains.count * mean_cubed_diameter(size)
    yield Check("the mass of all grains stays", volume, 50000 * 1e-9, rtol=1e-4)
    step = changed_scene().run.time_step
    yield Check("the time step shrinks with the finest", step, 1e-6 * finest, rtol=1e-4)


EFFECT = effect_of(__name__, "lognormal grain sizes in place of the median", "scene", change, most=2.0)
