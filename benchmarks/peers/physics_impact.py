"""A grain that strikes the plate obliquely, computed once more by the law of every code.

The sliders of friction and rolling differ in what limits them. Here it is mu times the normal force of the
spring alone, in the other codes that of spring and damper together. Over an impact both have one integral,

    int F_spring dt = int (F_spring + F_damper) dt,

since the damper's constant follows the overlap alone; but the whole force is large at first touch, when the
springs of friction and rolling are not yet stretched, so that it brakes the grain less.
"""

from dataclasses import dataclass, replace
from functools import cache
from math import copysign, hypot, log, pi, sqrt

import numpy as np

from benchmarks.peers.cases import Soil
from benchmarks.peers.physics_cases import Start, mass, shear_effective, young_effective
from benchmarks.peers.physics_column import ONE_LAW, column_soil, rolling_spring
from benchmarks.peers.physics_measures import Numbers, Rest

BRIEF = ("stages.0.duration_min=0.0", "stages.0.duration_max=1e-3", "stages.1.duration_max=1e-3")
IMPACT = replace(ONE_LAW, changes=(*BRIEF, "run.time_step=1.5e-6"))
SPEED = 0.1  # m s-1, downward and along the plate alike
GAP = 1e-7  # m, before the impact
ASIDE = 2e-3  # m, from the axis, on which rim and tube have no normal
FINER = 10  # time steps here in one of the codes


@dataclass(frozen=True)
class Sliders:
    """How a code limits friction and rolling."""

    whole: bool  # by the normal force of spring and damper together
    damper_inside: bool  # the tangential damper is limited together with its spring
    keeps_torque: bool  # rolling remembers its torque, which grows by increments, not its angle
    constant: bool  # the rolling spring is that under one load at any load


LAWS = {
    "ours": Sliders(False, False, False, False),
    "LIGGGHTS epsd2": Sliders(True, False, True, False),
    "LAMMPS": Sliders(True, True, False, True),
}


def oblique() -> Start:
    """The grain, without spin."""
    height = 0.5 * column_soil(IMPACT).diameter + GAP
    return Start(np.array([[ASIDE, 0.0, height]]), np.array([[SPEED, 0.0, -SPEED]]))


def limited(force: float, limit: float) -> float:
    """A force or torque that a slider limits."""
    return copysign(min(abs(force), limit), force)


@cache
def speed_left(law: Sliders, soil: Soil) -> float:
    """Speed along the plate after the impact over that before [1].

        m u' = m g - F,   m v' = -F_t,   (2/5) m R^2 w' = F_t R - M

    with u the speed downward, v that along the plate [m s-1], w the spin [rad s-1], F the normal force [N]
    and M the rolling torque [N m]; Euler's symplectic rule.
    """
    radius, weighs, step = 0.5 * soil.diameter, mass(soil), soil.time_step / FINER
    fixed, (normal, tangential) = rolling_spring(soil, radius), dampers(soil)
    down, along, spin, overlap, slip, torque, before = SPEED, SPEED, 0.0, 0.0, 0.0, 0.0, 0.0
    while overlap >= 0.0:
        overlap += down * step
        contact_radius = sqrt(radius * max(overlap, 1e-3 * GAP))
        spring = 4.0 / 3.0 * young_effective(soil) * contact_radius * max(overlap, 0.0)
        force = spring + normal * sqrt(contact_radius) * down
        cap = abs(force) if law.whole else spring
        stiffness, sliding = 8.0 * shear_effective(soil) * contact_radius, along - radius * spin
        drag = tangential * sqrt(contact_radius) * sliding
        slip += sliding * step
        inside = drag if law.damper_inside else 0.0
        wanted = stiffness * slip + inside
        friction = limited(wanted, soil.friction_wall * cap)
        slip = (friction - inside) / stiffness
        if friction == wanted and not law.damper_inside:
            friction += drag
        rolling = radius**2 * (fixed if law.constant else stiffness)
        kept = torque if law.keeps_torque or before == 0.0 else torque * rolling / before
        torque = limited(kept + rolling * spin * step, soil.friction_rolling * radius * cap)
        before = rolling
        down += (soil.gravity - force / weighs) * step
        along -= friction / weighs * step
        spin += (friction * radius - torque) / (0.4 * weighs * radius**2) * step
    return along / SPEED


def dampers(soil: Soil) -> tuple[float, float]:
    """Normal and tangential damping constant on the plate over the root of the contact radius [kg s-1 m-0.5].

    c_n = 2 sqrt(5/6) beta sqrt(2 E* m),  c_t = c_n sqrt(4 G* / E*)
    """
    ratio = -log(soil.restitution) / hypot(log(soil.restitution), pi)
    normal = 2.0 * sqrt(5.0 / 6.0) * ratio * sqrt(2.0 * young_effective(soil) * mass(soil))
    return normal, normal * sqrt(4.0 * shear_effective(soil) / young_effective(soil))


def impact_numbers(rest: Rest) -> Numbers:
    """Speed along the plate after the impact, over what the law of every code leaves."""
    found = float(rest.velocity[0, 0]) / SPEED
    for code, law in LAWS.items():
        yield f"speed left over that by the law of {code}", found / speed_left(law, column_soil(IMPACT))
