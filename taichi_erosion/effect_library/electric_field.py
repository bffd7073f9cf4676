"""Electric field of blowing sand: it lifts grains that lie on the bed and pulls grains in flight down.

    on bed     F_z = L pi eps0 d^2 E0^2,    L = zeta(3) + 1/6 = 1.3687
    in flight  F_z = -(q/m) m |E0| exp(-z / h)

with E0 the field at the bed [V m-1], d the diameter [m], eps0 the vacuum permittivity [F m-1], q/m the
charge over mass of a grain in flight [C kg-1], m the mass [kg], z the height above the bed [m], h the
scale height of the cloud [m]. Bed and cloud together are neutral, so that the cloud has the sign opposite
to the bed, whichever that is: by Gauss' law a charge density -eps0 E0 exp(-z / h) / h belongs to a field
E0 exp(-z / h), and the bed attracts every grain of the cloud. A grain on the bed has the charge that the
field induces on a conducting sphere on a conducting plane. The law of the bed holds up to a radius above
the bed and a radius below it, and fades over one diameter; deeper grains are screened. Strength multiplies
both forces. Holds for dry grains whose surface conducts enough to charge between two hops; on an
insulating bed the field holds grains down. 60 uC/kg in 166 kV/m, as Schmidt et al. measured, is one
weight. The lift is that of a sphere without neighbours, an upper bound for an exposed grain: the mean of a
closed bed is the stress eps0 E0^2 / 2, 8.6 times less on a square of the diameter (strength 0.12). The
field is given, not computed from what flies: it belongs to sand that blows, and lowers the wind at which
that ends.

Reference: Lebedev & Skal'skaya (1962), Sov. Phys. Tech. Phys. 7, 268 (sphere on a plane); Kok & Renno
(2006), Geophys. Res. Lett. 33, L19S10 (threshold) and (2008), Phys. Rev. Lett. 100, 014501 (grains in
flight stay closer to the bed); Schmidt, Schmidt & Dent (1998), J. Geophys. Res. 103, 8997 (charge and
field); Holstein-Rathlou et al. (2012), Icarus 220, 1 (less wind above 200 kV/m on a conducting bed, more
on an insulating one).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np

from taichi_erosion.core.effect import Check, Checks, Conditions, Constants, Probe, effect_of, quantity
from taichi_erosion.core.ti import ti

DRY = 0.005  # moisture above which charge leaks away along the films of water [kg kg-1], plausible size
PERMITTIVITY = 8.8541878e-12  # of vacuum, eps0 [F m-1], CODATA 2018
UNDER_WIND = {"bed_height": 0.01}  # conditions of a check [m]
SPHERE_ON_PLANE = 1.2020569 + 1.0 / 6.0  # L = zeta(3) + 1/6 [1]


@dataclass(frozen=True)
class Params:
    charge: float = quantity(2e-5, "C kg-1", "charge over mass of a grain in flight", low=0.0, high=1e-4)
    field: float = quantity(1e5, "V m-1", "size of the field at the bed", low=0.0, high=3e5)
    scale_height: float = quantity(0.05, "m", "height over which the field falls by e", low=1e-3, high=1.0)


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica; moist grains hold no charge, and without wind no sand blows."""
    blows = float(conditions.get("moisture", 0.0) <= DRY and "bed_height" in conditions)
    return {
        # force over d^2 [Pa]
        "lift": blows * strength * SPHERE_ON_PLANE * pi * PERMITTIVITY * params.field**2,
        "pull": blows * strength * params.charge * params.field,  # force over mass at the bed [m s-2]
        "height": params.scale_height,
    }


@ti.func
def push(constants, grain):
    """Force [N] and torque [N m]."""
    diameter = 2.0 * grain.radius
    away = (ti.abs(grain.height) - grain.radius) / diameter
    near = 1.0 - ti.min(ti.max(away, 0.0), 1.0)
    aloft = ti.select(grain.height > 0.0, 1.0 - near, 0.0)
    faded = ti.exp(-ti.max(grain.height, 0.0) / constants.height)
    force = 0.0 * grain.velocity
    force[2] = near * constants.lift * diameter * diameter - aloft * constants.pull * grain.mass * faded
    return force, 0.0 * force


def can_act(conditions: Mapping[str, Any]) -> Any:
    """Moist grains hold no charge."""
    return np.asarray(conditions.get("moisture", 0.0)) <= DRY


def checks(probe: Probe) -> Checks:
    charged = Params(charge=6e-5, field=1.66e5, scale_height=0.02)

    def lift(height: float, moisture: float = 0.0, bed: Conditions = UNDER_WIND) -> float:
        members = {"height": height, "radius": 1e-4, "mass": 1e-8}
        return probe(charged, {"moisture": moisture, **bed}, **members)[0][2]

    # 4 pi eps0 R^2 E0^2 = (1e-4 * 1.66e5)^2 / 8.9875518e9
    bed = 1.3687236 * 16.6**2 / 8.9875518e9
    yield Check("a grain on the bed is lifted like a sphere on a plane", lift(1e-4), bed)
    yield Check("in flight the bed pulls it with q E", lift(0.02), -9.96e-8 * 0.36787944)
    yield Check("two scale heights up by another e", lift(0.04), -9.96e-8 * 0.13533528)
    both = 0.5 * (bed - 9.96e-8 * 0.99004983)
    yield Check("at a diameter above the bed it is half of each", lift(2e-4), both)
    yield Check("deep grains are screened", lift(-4e-4), 0.0)
    yield Check("a moist bed holds no charge", lift(1e-4, moisture=0.01), 0.0)
    yield Check("without wind there is no field", lift(1e-4, bed={}), 0.0)


EFFECT = effect_of(
    __name__,
    "electric field of blowing sand: lift on the bed, pull in flight",
    "grain",
    push,
    reads=("moisture",),
    expected={"threshold_u_star": -1},
)
