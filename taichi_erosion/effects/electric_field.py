"""Electric field of blowing sand: the vertical force on charged grains above a charged bed.

    F_z = s(d) (q/m) m E0 exp(-max(z, 0) / h),    s(d) = +1 for d >= d_n, -1 for d < d_n

with q/m the charge over mass [C kg-1], m the mass [kg], E0 the field at the bed, upwards [V m-1], z the
height of the grain above the bed [m], h the scale height of the cloud [m], d the diameter and d_n the
diameter that stays neutral [m]. Bed and cloud together are neutral and the charge of the cloud thins out
like exp(-z / h); then its field does too. Large grains charge positively when they rub on small ones. With
E0 upwards the field carries part of the weight of coarse grains and holds fine ones to the bed. Strength
multiplies the charge. Holds for dry grains; 60 uC/kg in 166 kV/m is one weight, as much as has ever been
measured.

Reference: Schmidt, Schmidt & Dent (1998), J. Geophys. Res. 103, 8997 (charge and field); Kok & Renno
(2008), Phys. Rev. Lett. 100, 014501 (field in a saltation model); Forward, Lacks & Sankaran (2009),
Geophys. Res. Lett. 36, L13201 (sign of the charge by size).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe, quantity
from taichi_erosion.core.ti import ti

DRY = 0.005  # moisture above which charge leaks away along the films of water [kg kg-1], plausible size


@dataclass(frozen=True)
class Params:
    charge: float = quantity(2e-5, "C kg-1", "charge over mass", low=0.0, high=1e-4)
    field: float = quantity(1e5, "V m-1", "field at the bed, upwards", low=-3e5, high=3e5)
    scale_height: float = quantity(0.05, "m", "height over which the field falls by e", low=1e-3, high=1.0)
    neutral_diameter: float = quantity(1e-4, "m", "finer grains are negative", low=0.0, high=1e-2)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica; moist grains hold no charge."""
    dry = float(conditions.get("moisture", 0.0) <= DRY)
    return {
        "push": dry * strength * params.charge * params.field,  # force over mass at the bed [m s-2]
        "height": params.scale_height,
        "neutral": 0.5 * params.neutral_diameter,
    }


@ti.func
def push(constants, grain):
    """Force [N] and torque [N m]."""
    sign = ti.select(grain.radius >= constants.neutral, 1.0, -1.0)
    faded = ti.exp(-ti.max(grain.height, 0.0) / constants.height)
    force = 0.0 * grain.velocity
    force[2] = sign * constants.push * grain.mass * faded
    return force, 0.0 * force


def can_act(conditions: Mapping[str, NDArray[np.float64]]) -> Any:
    """Moist grains hold no charge."""
    return np.asarray(conditions.get("moisture", 0.0)) <= DRY


def checks(probe: Probe) -> Iterator[Check]:
    charged = Params(charge=6e-5, field=1.66e5, scale_height=0.02, neutral_diameter=2e-4)

    def lift(height: float, radius: float = 1.05e-4, moisture: float = 0.0) -> float:
        members = {"height": height, "radius": radius, "mass": 1e-8}
        return probe(charged, {"moisture": moisture}, **members)[0][2]

    yield Check("at the bed a grain of 60 uC/kg is lifted with q E", lift(0.0), 9.96e-8)
    yield Check("one scale height up the force has fallen by e", lift(0.02), 9.96e-8 * 0.36787944)
    yield Check("in the bed the field is that at its surface", lift(-0.001), 9.96e-8)
    yield Check("grains finer than the neutral diameter are held down", lift(0.0, 0.95e-4), -9.96e-8)
    yield Check("a moist bed holds no charge", lift(0.0, moisture=0.01), 0.0)


EFFECT = Effect(
    name="electric_field",
    title="vertical force of the sand's electric field on charged grains",
    doc=__doc__,
    place="grain",
    params=Params,
    act=push,
    checks=checks,
    constants=constants,
    reads=("moisture",),
    can_act=can_act,
    expected={"threshold_u_star": -1, "flux": 1},
)
