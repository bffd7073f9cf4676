"""Rolling resistance: angular grains do not roll freely, which spheres make up for by a torque (type C).

    mu_r = mu_r0 + strength m a^n,    torque <= mu_r R* F_n

with mu_r0 the rolling friction of the bare scene (0 where it has no rolling law) [1], m the rolling
friction of the most angular grains [1], a the angularity of the grains, 0 round to 1 most angular [1]: that
of the conditions, or the parameter where they state none. How rolling grows with an index of shape depends on
the index, so that n is 1 until measurements say more. The torque is that of an elastic-plastic spring
in every contact of the grains, with walls too; a scene that has a rolling law keeps it. m = 0.28 gives 0.14
at a = 1/2, which a heap of desert sand was calibrated to. Strength multiplies the added friction. Holds for
grains that differ little from spheres; clumps are the resolved counterpart (grain_shape).

Reference: Ai, Chen, Rotter & Ooi (2011), Powder Technology 206, 269 (type C); Wensrich & Katterfeld (2012),
Powder Technology 217, 409 (rolling friction in place of shape); Zhou, Xu, Yu & Zulli (2001), Phys. Rev. E
64, 021301 (repose angle).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene, with_contacts, with_section
from taichi_erosion.scene.schema.grains import Contact


@dataclass(frozen=True)
class Params:
    friction_rolling: float = quantity(0.28, "1", "of the most angular grains", low=0.0, high=1.0)
    angularity: float = quantity(0.5, "1", "where the conditions state none", low=0.0, high=1.0)
    exponent: float = quantity(1.0, "1", "of rolling friction against angularity", low=0.2, high=4.0)


def dose(params: Params, conditions: Mapping[str, Any]) -> Any:
    """Share of the rolling friction of the most angular grains [1]."""
    return np.asarray(conditions.get("angularity", params.angularity)) ** params.exponent


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with more rolling friction; the law comes with it, also for round grains.

    Replicas of an ensemble share their laws, and a rolling friction of 0 exerts nothing.
    """
    friction = strength * params.friction_rolling * float(dose(params, conditions))
    if strength == 0.0:
        return scene
    bare = scene.laws.rolling == "none"
    with_law = with_section(scene, "laws", rolling="elastic_plastic") if bare else scene
    share = 0.0 if bare else 1.0

    def stiffer(contact: Contact) -> Contact:
        after = share * contact.friction_rolling + friction / contact.rolling_radius_ratio
        return contact.model_copy(update={"friction_rolling": after})

    return with_contacts(with_law, stiffer)


def can_act(conditions: Mapping[str, Any]) -> Any:
    """Round grains roll."""
    return np.asarray(conditions.get("angularity", 1.0)) > 0.0


def checks(probe: Probe) -> Checks:
    shape = Params(friction_rolling=0.4, angularity=0.5, exponent=2.0)
    bare, rolling = sample_scene(), sample_scene(laws={"rolling": "constant_torque"})

    def friction(pair: str, scene: Scene, strength: float = 1.0, **conditions: float) -> float:
        return probe(shape, conditions, scene=scene, strength=strength).contact[pair].friction_rolling

    law = probe(shape, {}, scene=bare).laws.rolling
    remainder = probe(shape, {}, scene=rolling).laws.rolling
    yield Check("a bare scene gets the law of type C", float(law == "elastic_plastic"), 1.0)
    yield Check("where it starts from nothing", friction("sand-sand", bare, angularity=0.8), 0.256)
    yield Check("angularity is assumed where none is stated", friction("sand-sand", bare), 0.1)
    yield Check("a rolling law is kept", float(remainder == "constant_torque"), 1.0)
    yield Check("and friction is added to what it has", friction("sand-steel", rolling, 0.5), 0.25)
    yield Check("round grains roll on freely", friction("sand-sand", bare, angularity=0.0), 0.0)


EFFECT = effect_of(
    __name__,
    "rolling resistance of angular grains (type C)",
    "scene",
    change,
    reads=("angularity",),
    uncertain={"exponent": 0.35},
    expected={"repose_angle": 1, "threshold_u_star": 1},
)
