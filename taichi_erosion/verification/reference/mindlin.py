"""Oblique impact of a sphere on a rigid plane, integrated a second time with a fine step.

    m dv_n/dt = (4/3) E* sqrt(R) d^1.5 - c_n v_n,   c_n = 2 sqrt(5/6) beta sqrt(2 E* a m),   a = sqrt(R d)
    F_t = -8 G* a xi - c_t v_s,   |F_t| <= mu F_cap,   c_t = 2 sqrt(5/6) beta sqrt(8 G* a m)

v_s = v_t + R omega is the slip and xi its integral over the contact (total form, no slip); the lever arm is
R. Codes differ in what happens where friction slides; `Sliding` names three ways:

- `TOGETHER`: F_cap is the elastic force; spring and dashpot together are cut to the cap, and xi is shortened
  so that both equal it. A strong dashpot then loads the spring backwards at first touch, and gross sliding
  loses 1 % (e = 0.5) to 6 % (e = 0.2) of its impulse.
- `APART`: F_cap is the elastic force; the spring alone is held against it, and the dashpot is left out while
  it slides. Gross sliding is exact for every e.
- `TABLE`, behind the table of own values for test 4: as `APART`, with the whole normal force for F_cap.

All give the same gross sliding for e near 1; they part below 10 deg, where the contact mostly sticks.
Vectorised over impacts; leapfrog with `steps` per elastic contact time.

Reference: Tsuji et al. (1992), Powder Technology 71, 239, with Mindlin's no-slip stiffness.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.verification.reference.hertz import DURATION_FACTOR, damping_ratio

Floats = NDArray[np.float64]

DAMPING_FACTOR = 2.0 * np.sqrt(5.0 / 6.0)  # makes e independent of speed for Hertz stiffness [1]
LEAST = 1e-300  # keeps the spring of a contact of no depth finite [N m-1]
LONGEST = 3.0  # contact times after which an impact must be over [1]


class Sliding(Enum):
    """What caps friction, and what becomes of spring and dashpot there."""

    TOGETHER = "together"
    APART = "apart"
    TABLE = "table"


OWN_LAW = Sliding.APART  # what `grains/contact.py` does


@dataclass(frozen=True)
class Impact:
    """Impacts of one kind of sphere; `normal`, `tangential` and `spin` have one entry per impact."""

    young: float  # E*, Pa
    shear: float  # G*, Pa
    restitution: float
    friction: float
    radius: float  # m
    mass: float  # kg
    normal: Floats  # m s-1, towards the plane
    tangential: Floats  # m s-1
    spin: Floats  # rad s-1, positive where it adds to the slip
    sliding: Sliding = OWN_LAW


@dataclass(frozen=True)
class Rebound:
    """State after the contact; `normal` is positive away from the plane."""

    normal: Floats  # m s-1
    tangential: Floats  # m s-1
    spin: Floats  # rad s-1


@dataclass
class Contact:
    """What evolves during the contact."""

    overlap: Floats
    closing: Floats
    tangential: Floats
    spin: Floats
    spring: Floats
    open: NDArray[np.bool_]


def rebound(impact: Impact, steps: int = 20_000) -> Rebound:
    """Velocities and spin after the impact."""
    stiffness = 4.0 / 3.0 * impact.young * np.sqrt(impact.radius)
    depth = (5.0 * impact.mass * impact.normal**2 / (4.0 * stiffness)) ** 0.4
    step = DURATION_FACTOR * depth / impact.normal / steps
    state = Contact(
        overlap=np.zeros_like(step),
        closing=impact.normal + 0.0,
        tangential=impact.tangential + 0.0,
        spin=impact.spin + 0.0,
        spring=np.zeros_like(step),
        open=np.ones(step.shape, bool),
    )
    for _ in range(int(LONGEST * steps)):
        if state.open.any():
            advance(impact, state, step)
    return Rebound(-state.closing, state.tangential, state.spin)


def advance(impact: Impact, state: Contact, step: Floats) -> None:
    """One leapfrog step of every impact that still touches."""
    move = np.where(state.open, step, 0.0)
    slip_speed = state.tangential + impact.radius * state.spin
    state.overlap += move * state.closing
    state.spring += move * slip_speed
    state.open &= state.overlap > 0.0
    move = np.where(state.open, step, 0.0)
    depth = np.maximum(state.overlap, 0.0)
    contact_radius = np.sqrt(impact.radius * depth)
    viscous = DAMPING_FACTOR * damping_ratio(impact.restitution)
    elastic = 4.0 / 3.0 * impact.young * contact_radius * depth
    normal = elastic + viscous * np.sqrt(2.0 * impact.young * contact_radius * impact.mass) * state.closing
    stiffness = 8.0 * impact.shear * contact_radius
    dashpot = viscous * np.sqrt(stiffness * impact.mass) * slip_speed
    cap = impact.friction * (np.abs(normal) if impact.sliding is Sliding.TABLE else elastic)
    cut = cut_together if impact.sliding is Sliding.TOGETHER else cut_spring
    friction, spring = cut(stiffness, state.spring, dashpot, cap)
    state.spring = np.where(state.open, spring, state.spring)
    state.closing -= move / impact.mass * normal
    state.tangential += move / impact.mass * friction
    state.spin += move * friction * impact.radius / (0.4 * impact.mass * impact.radius**2)


def cut_together(stiffness: Floats, spring: Floats, dashpot: Floats, limit: Floats) -> tuple[Floats, Floats]:
    """Friction [N] and spring [m] after it, where spring and dashpot share the cap."""
    whole = -stiffness * spring - dashpot
    force = np.clip(whole, -limit, limit)
    shortened = -(force + dashpot) / np.maximum(stiffness, LEAST)
    return force, np.where(np.abs(whole) > limit, shortened, spring)


def cut_spring(stiffness: Floats, spring: Floats, dashpot: Floats, limit: Floats) -> tuple[Floats, Floats]:
    """Friction [N] and spring [m] after it, where the spring alone is capped and the dashpot acts while it
    sticks.
    """
    elastic = -stiffness * spring
    slides = np.abs(elastic) > limit
    force = np.where(slides, np.clip(elastic, -limit, limit), elastic - dashpot)
    return force, np.where(slides, -force / np.maximum(stiffness, LEAST), spring)
